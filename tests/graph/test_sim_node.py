"""The simulation node as a process of its own, driven over DDS."""

import os
import signal
import subprocess
import sys
import time
from functools import partial

import numpy as np
import pytest
import rclpy
from rcl_interfaces.srv import SetParameters
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rled_msgs_py.records import DeltaCommand
from rled_msgs_py.reset_answer import ResetAnswer
from rled_msgs_py.ros.convert import MESSAGE_CLASSES, from_msg, qos_profile, to_msg
from rled_msgs_py.ros.node import advertise, fresh_context
from rled_msgs_py.task import TaskDescription
from rled_msgs_py.task_limits import Zone
from rled_msgs_py.tick import STATE_TOPICS, TickAssembler
from rled_msgs_py.topics import (
    CLOCK_TOPIC,
    DIAGNOSTICS,
    JOINT_DELTA,
    MARKERS,
    ROBOT_DESCRIPTION,
    TASK_DESCRIPTION,
)
from rled_sim.robots import ROBOTS
from std_srvs.srv import SetBool, Trigger

WAIT_TIMEOUT = 60.0
PERIOD = 20_000_000


class Simulation:
    """A sim_node process."""

    def __init__(self, *arguments):
        command = [sys.executable, "-m", "rled_sim.nodes.sim_node", "--discovery-wait", "0.3", *arguments]
        self.process = subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True)

    def end(self, number=signal.SIGINT):
        if self.process.poll() is None:
            self.process.send_signal(number)
        try:
            out, err = self.process.communicate(timeout=WAIT_TIMEOUT)
        except subprocess.TimeoutExpired:
            self.process.kill()
            raise
        return self.process.returncode, out, err


class Operator:
    """Another participant of the graph: sees what the simulation publishes, sends what it is told to."""

    def __init__(self):
        self.context = fresh_context()
        self.node = Node("operator", context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.ticks, self.messages, self.latched, self.health, self.clock, self.markers = [], [], {}, [], [], []
        self._assembler = TickAssembler()
        for topic in STATE_TOPICS:
            self._listen(topic, partial(self._on_state, topic))
        for topic in (ROBOT_DESCRIPTION, TASK_DESCRIPTION):
            self._listen(topic, partial(self._on_latched, topic))
        self._listen(CLOCK_TOPIC, lambda msg: self.clock.append(msg.clock.sec * 10**9 + msg.clock.nanosec))
        self._listen(MARKERS, self.markers.append)
        self._listen(DIAGNOSTICS, lambda msg: self.health.append(from_msg(DIAGNOSTICS, msg)))
        self.output = advertise(self.node, JOINT_DELTA)

    def _listen(self, topic, callback):
        self.node.create_subscription(MESSAGE_CLASSES[topic.type], topic.name, callback, qos_profile(topic.qos))

    def _on_state(self, topic, msg):
        self.messages.append(f"{topic.name} {msg}")
        tick = self._assembler.add(topic.name, from_msg(topic, msg))
        if tick is not None:
            self.ticks.append(tick)

    def _on_latched(self, topic, msg):
        self.latched[topic] = msg.data

    def wait(self, done, what):
        deadline = time.monotonic() + WAIT_TIMEOUT
        while not done():
            assert time.monotonic() < deadline, f"waited {WAIT_TIMEOUT} s for {what}"
            self.executor.spin_once(timeout_sec=0.05)

    def spin_for(self, seconds):
        deadline = time.monotonic() + seconds
        while time.monotonic() < deadline:
            self.executor.spin_once(timeout_sec=0.01)

    def meet(self):
        self.wait(lambda: self.ticks and self.output.get_subscription_count() and len(self.latched) == 2, "sim_node")
        return self

    @property
    def tick(self):
        return self.ticks[-1]

    @property
    def task(self):
        return TaskDescription.from_json(self.latched[TASK_DESCRIPTION])

    def send(self, delta, names=None, stamp=None):
        stamp = self.tick.stamp if stamp is None else stamp
        self.output.publish(to_msg(DeltaCommand(stamp, tuple(names or self.task.joint_names), np.array(delta))))

    def send_unchecked(self, **fields):
        message = to_msg(DeltaCommand(self.tick.stamp, self.task.joint_names, np.zeros(len(self.task.joint_names))))
        for name, value in fields.items():
            setattr(message, name, value)
        self.output.publish(message)

    def step(self, delta, **options):
        before = len(self.ticks)
        self.send(delta, **options)
        self.wait(lambda: len(self.ticks) > before, "the next tick")
        return self.ticks[before]

    def wait_for_an_open_episode(self):
        self.wait(lambda: not (self.tick.status.terminated or self.tick.status.truncated), "the next episode")

    def wait_for_stamp(self, stamp):
        self.wait(lambda: self.tick.stamp >= stamp, f"the tick of {stamp} ns")

    def call(self, kind, service, request):
        client = self.node.create_client(kind, service)
        self.wait(client.service_is_ready, service)
        future = client.call_async(request)
        self.wait(future.done, f"an answer of {service}")
        self.node.destroy_client(client)
        return future.result()

    def reset(self):
        return self.call(Trigger, "sim/reset", Trigger.Request())

    def switch(self, service, on):
        return self.call(SetBool, f"sim/{service}", SetBool.Request(data=on))

    def set(self, name, value):
        request = SetParameters.Request(parameters=[Parameter(name, value=value).to_parameter_msg()])
        return self.call(SetParameters, "sim/set_parameters", request).results[0]

    def report(self, key, value):
        """The first health whose ``key`` is ``value``, from now on."""
        begin = len(self.health)

        def found():
            return [each for each in self.health[begin:] if each.values.get(key) == value]

        self.wait(found, f"{key}={value} on /diagnostics")
        return found()[0]

    def close(self):
        self.executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)


@pytest.fixture
def start():
    """Call with the command line of a simulation; returns an operator that has met it."""
    running = []

    def starter(*arguments):
        running.append(Simulation(*arguments))
        running.append(Operator())
        return running[-1].meet()

    yield starter
    for each in reversed(running):
        each.close() if isinstance(each, Operator) else each.end()


def test_lockstep_holds_each_tick_until_its_answer(start):
    operator = start("--robot", "planar")
    assert operator.tick.stamp == 0
    operator.spin_for(0.3)
    assert len(operator.ticks) == 1
    tick = operator.step((0.05, -0.02))
    assert tick.stamp == PERIOD
    np.testing.assert_allclose(tick.joints.position, (-0.85, 1.78), atol=1e-15)
    np.testing.assert_allclose(tick.joints.velocity, (2.5, -1.0), atol=1e-9)
    assert (tick.status.step, tick.status.episode) == (1, 0)
    np.testing.assert_allclose(tick.ee.position, ROBOTS["planar"].chain.position(tick.joints.position), atol=1e-6)
    operator.wait(lambda: PERIOD in operator.clock, "/clock")


def test_graph_describes_itself(start):
    operator = start("--robot", "planar", "--reward", "sparse", "--max-steps", "7", "--period", "0.05")
    assert operator.latched[ROBOT_DESCRIPTION] == ROBOTS["planar"].description
    assert (operator.task.robot, operator.task.reward, operator.task.max_steps) == ("planar", "sparse", 7)
    assert operator.task.period == 50_000_000
    operator.wait(lambda: operator.markers, "markers")
    assert {each.ns for each in operator.markers[0].markers} == {"curve", "trail", "start", "target"}


def test_two_runs_with_one_seed_give_the_same_messages(start):
    runs = []
    for _ in range(2):
        simulation, operator = Simulation("--robot", "panda", "--seed", "3", "--max-steps", "15"), Operator().meet()
        rng = np.random.default_rng(0)
        for _ in range(40):
            operator.step(rng.uniform(-0.04, 0.04, 7))
            operator.wait_for_an_open_episode()
        runs.append(sorted(operator.messages))
        operator.close()
        simulation.end()
    assert len(runs[0]) == 4 * 43
    assert runs[0] == runs[1]


def test_graph_gives_the_transitions_of_the_environment(start):
    import gymnasium

    operator = start("--robot", "panda", "--start-points", "", "--seed", "0")
    operator.set("seed", 11)
    begins = ResetAnswer.from_json(operator.reset().message).stamp
    operator.wait_for_stamp(begins)
    env = gymnasium.make("rled/PandaReach-v0")
    observation, _ = env.reset(seed=11)
    rng = np.random.default_rng(0)
    for _ in range(60):
        tick = operator.tick
        seen = operator.task.observe(tick.joints.position, tick.ee.position, tick.target.position)
        assert seen.astype(np.float32).tobytes() == observation.tobytes()
        action = rng.uniform(-0.04, 0.04, 7).astype(np.float32)
        observation, reward, *_ = env.step(action)
        assert operator.step(action.astype(np.float64)).status.reward == reward
    env.close()


@pytest.fixture(scope="class")
def planar(ros_domain):
    """One simulation for the tests that leave it waiting."""
    simulation, operator = Simulation("--robot", "planar", "--max-steps", "0", "--targets-per-episode", "0"), Operator()
    yield operator.meet()
    operator.close()
    simulation.end()


class TestWaitingSimulation:
    def test_largest_float32_action_is_taken_and_clipped(self, planar):
        before = planar.tick.joints.position
        tick = planar.step(np.full(2, np.float32(0.1), np.float64))  # a little more than 0.1
        np.testing.assert_array_equal(tick.joints.position, before + 0.1)

    def test_names_in_another_order_are_brought_into_order(self, planar):
        before = planar.tick.joints.position
        tick = planar.step((-0.02, 0.05), names=("elbow", "shoulder"))
        np.testing.assert_allclose(tick.joints.position, np.add(before, (0.05, -0.02)), atol=1e-15)

    @pytest.mark.parametrize(
        ("fields", "code", "text"),
        [
            ({"name": ["shoulder"], "position": [0.01]}, 2, "elbow"),
            ({"name": ["shoulder", "wrist"]}, 2, "wrist"),
            ({"name": ["shoulder", "shoulder"]}, 1, "distinct"),
            ({"position": [0.01, float("nan")]}, 1, "nan"),
            ({"position": [float("inf"), 0.0]}, 1, "inf"),
            ({"position": [0.01]}, 1, "shape (1,)"),
            ({"position": [0.101, 0.0]}, 3, "at most 0.1 rad"),
        ],
        ids=["missing", "unknown", "twice", "nan", "infinity", "short", "large"],
    )
    def test_bad_delta_is_refused_counted_and_moves_nothing(self, planar, fields, code, text):
        operator, before = planar, planar.tick
        operator.send_unchecked(**fields)
        health = operator.report("code", str(code))
        assert text in health.values["text"]
        counted = {1: "commands_unreadable", 2: "commands_wrong_names", 3: "commands_too_large"}[code]
        assert int(health.values[counted]) >= 1
        assert operator.tick.stamp == before.stamp
        tick = operator.step((0.01, 0.0))  # the simulation still waits for the answer to its tick
        assert tick.stamp == before.stamp + PERIOD
        np.testing.assert_allclose(tick.joints.position, np.add(before.joints.position, (0.01, 0.0)), atol=1e-15)

    def test_stale_and_future_answers_are_refused_in_lockstep(self, planar):
        stamp = planar.step((0.0, 0.0)).stamp
        planar.send((0.05, 0.0), stamp=stamp - PERIOD)
        assert f"{stamp - PERIOD} ns" in planar.report("code", "4").values["text"]
        planar.send((0.05, 0.0), stamp=stamp + PERIOD)
        planar.report("code", "5")
        assert planar.tick.stamp == stamp

    def test_reset_begins_an_episode_with_a_new_stamp(self, planar):
        planar.step((0.05, 0.0))
        before = planar.tick
        answer = planar.reset()
        assert answer.success
        told = ResetAnswer.from_json(answer.message)
        assert (told.episode, told.stamp) == (before.status.episode + 1, before.stamp + PERIOD)
        planar.wait(lambda: planar.tick.stamp > before.stamp, "the new episode")
        assert (planar.tick.status.step, planar.tick.status.episode) == (0, before.status.episode + 1)
        np.testing.assert_array_equal(planar.tick.joints.position, ROBOTS["planar"].home)

    def test_seed_takes_effect_at_the_next_reset_also_when_it_is_the_same(self, planar):
        targets = []
        for _ in range(2):
            assert planar.set("seed", 5).successful
            for _ in range(3):
                begins = ResetAnswer.from_json(planar.reset().message).stamp
                planar.wait_for_stamp(begins)
                targets.append(planar.tick.target.position.tolist())
        assert targets[:3] == targets[3:]
        assert targets[0] != targets[1]

    def test_emergency_stop_holds_until_released(self, planar):
        before = planar.step((0.0, 0.0))
        assert planar.switch("estop", True).success
        planar.send((0.05, 0.0))
        assert planar.report("code", "6").message == "emergency stop"
        refused = planar.reset()
        assert not refused.success
        assert "emergency stop" in refused.message
        assert planar.tick.stamp == before.stamp
        planar.switch("estop", False)
        planar.wait(lambda: planar.tick.stamp > before.stamp, "a tick to answer")
        np.testing.assert_array_equal(planar.tick.joints.position, before.joints.position)
        assert planar.tick.status.step == before.status.step
        moved = planar.step((0.05, 0.0))
        np.testing.assert_allclose(moved.joints.position, np.add(before.joints.position, (0.05, 0.0)), atol=1e-15)

    def test_paused_simulation_carries_the_answer_out_afterwards(self, planar):
        before = planar.step((0.0, 0.0))
        planar.switch("pause", True)
        planar.send((0.05, 0.0))
        planar.report("code", "0")
        assert planar.tick.stamp == before.stamp
        planar.switch("pause", False)
        planar.wait(lambda: planar.tick.stamp > before.stamp, "the step")
        np.testing.assert_allclose(planar.tick.joints.position, np.add(before.joints.position, (0.05, 0.0)), atol=1e-15)

    def test_fixed_parameters_and_wrong_values_are_refused(self, planar):
        assert not planar.set("robot", "panda").successful
        assert not planar.set("command_timeout", -1.0).successful
        assert planar.set("command_timeout", 0.2).successful

    def test_late_operator_receives_the_waiting_tick(self, planar):
        planar.step((0.0, 0.0))
        late = Operator().meet()
        late.wait(lambda: late.tick.stamp == planar.tick.stamp, "the waiting tick")
        late.close()


def test_last_tick_of_an_episode_is_followed_at_once(start):
    operator = start(
        "--robot", "planar", "--max-steps", "2", "--seed", "1"
    )  # whose first target is not where it stands
    operator.step((0.0, 0.0))
    operator.step((0.0, 0.0))
    operator.wait(lambda: len(operator.ticks) == 4, "the next episode")
    assert [tick.status.truncated for tick in operator.ticks] == [False, False, True, False]
    assert [tick.status.step for tick in operator.ticks] == [0, 1, 2, 0]
    assert [tick.stamp for tick in operator.ticks] == [0, PERIOD, 2 * PERIOD, 3 * PERIOD]


def test_without_auto_reset_the_simulation_waits_for_a_reset(start):
    operator = start("--robot", "planar", "--max-steps", "1", "--no-auto-reset", "--seed", "1")
    assert operator.step((0.0, 0.0)).status.truncated
    operator.send((0.05, 0.0))
    operator.report("code", "7")
    assert len(operator.ticks) == 2
    operator.reset()
    operator.wait(lambda: len(operator.ticks) == 3, "the next episode")
    assert operator.tick.status.episode == 1


def test_motion_that_a_limit_forbids_is_a_step_without_motion_and_counted(start):
    operator = start("--robot", "planar", "--keep-out", "sphere 0.6216 0 0.1 0.05")  # the tip's place at home
    assert operator.task.limits.keep_out == (Zone("sphere", (0.6216, 0.0, 0.1), (0.05,)),)
    tick = operator.step((0.1, 0.0))  # out of it
    assert tick.status.refused == ""
    tick = operator.step((-0.1, 0.0))
    assert (tick.status.refused, tick.status.step) == ("keep_out", 2)
    np.testing.assert_array_equal(tick.joints.position, operator.ticks[-2].joints.position)
    health = operator.report("code", "12")
    assert health.values["commands_keep_out"] == "1"
    assert "keep-out sphere" in health.values["text"]


@pytest.fixture(scope="class")
def ticking(ros_domain):
    """One simulation in real time."""
    simulation, operator = Simulation("--robot", "planar", "--mode", "real_time"), Operator()
    yield operator.meet()
    operator.close()
    simulation.end()


class TestTickingSimulation:
    def test_ticks_come_by_themselves_and_hold_without_a_command(self, ticking):
        begin, first = time.monotonic(), ticking.tick
        ticking.wait_for_stamp(first.stamp + 50 * PERIOD)
        assert time.monotonic() - begin > 0.5  # half as long as they take: the first may have waited to be seen
        np.testing.assert_array_equal(ticking.tick.joints.position, ROBOTS["planar"].home)
        assert ticking.tick.status.step == 0

    def test_stale_command_is_a_hold(self, ticking):
        old = ticking.tick
        ticking.wait_for_stamp(old.stamp + 10 * PERIOD)
        ticking.send((0.05, 0.0), stamp=old.stamp)
        assert ticking.report("code", "4").values["commands_stale"] == "1"
        np.testing.assert_array_equal(ticking.tick.joints.position, old.joints.position)

    def test_fresh_command_is_carried_out_once(self, ticking):
        ticking.set("command_timeout", 10.0)
        before = ticking.tick
        ticking.send((0.05, 0.0))
        ticking.wait(lambda: ticking.tick.status.step == before.status.step + 1, "the command")
        ticking.wait_for_stamp(ticking.tick.stamp + 10 * PERIOD)
        np.testing.assert_allclose(
            ticking.tick.joints.position, np.add(before.joints.position, (0.05, 0.0)), atol=1e-15
        )
        assert ticking.tick.status.step == before.status.step + 1

    def test_emergency_stop_ticks_on_and_holds(self, ticking):
        ticking.set("command_timeout", 10.0)
        ticking.switch("estop", True)
        held = ticking.tick
        ticking.send((0.05, 0.0))
        ticking.report("code", "6")
        ticking.wait_for_stamp(held.stamp + 10 * PERIOD)
        np.testing.assert_array_equal(ticking.tick.joints.position, held.joints.position)
        ticking.switch("estop", False)


def test_motors_report_their_contacts(start):
    operator = start("--robot", "panda", "--transition", "motors", "--targets-per-episode", "0")
    for _ in range(80):
        operator.step((0.0, 0.04, 0.0, 0.0, 0.0, 0.0, 0.0))
    operator.wait(lambda: any("floor" in each.values["contacts"] for each in operator.health), "contacts")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_node_ends_cleanly_on_a_signal(start, number):
    simulation, operator = Simulation("--robot", "planar"), Operator()
    operator.meet()
    operator.close()
    code, _, err = simulation.end(number)
    assert "Traceback" not in err
    assert code in (0, 130)


def test_second_simulation_in_the_domain_is_refused(start):
    start("--robot", "planar")
    second = Simulation("--robot", "planar", "--discovery-wait", "20")
    second.process.wait(WAIT_TIMEOUT)
    code, _, err = second.end()
    assert code == 2
    lines = [line for line in err.splitlines() if "RTPS" not in line]
    assert len(lines) == 1
    assert "joint_states has a publisher already" in lines[0]
    assert "ROS_DOMAIN_ID" in lines[0]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--robot", "ur5"), "robot is 'ur5'; accepted: panda, planar"),
        (("--mode", "fast"), "mode is 'fast'; accepted: lockstep, real_time"),
        (("--period", "0"), "period is 0.0; accepted: 0.001 to 1.0"),
        (("--seed", "x"), "invalid int value: 'x'"),
        (("--speed", "2"), "unrecognized arguments: --speed 2"),
        (("--start-points", "no/such/bag"), "no/such/bag"),
        (("--keep-out", "cone 0 0 0 1"), "shape 'cone'; accepted: box, sphere, cylinder"),
        (("--ros-args", "-p", "robot:=ur5"), "robot is 'ur5'; accepted: panda, planar"),
    ],
)
def test_bad_command_line_is_one_line_and_exit_code_2(arguments, said):
    code, out, err = Simulation(*arguments).end(number=0)
    lines = [line for line in err.splitlines() if "RTPS" not in line]
    assert code == 2
    assert out == ""
    assert len(lines) == 1
    assert said in lines[0]


def test_window_without_a_display_is_refused(monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    code, _, err = Simulation("--gui").end(number=0)
    assert code == 2
    assert "no display" in err


def test_domain_that_does_not_exist_is_refused(monkeypatch):
    monkeypatch.setitem(os.environ, "ROS_DOMAIN_ID", "500")
    code, _, err = Simulation().end(number=0)
    assert (code, err.count("\n")) == (2, 1)
    assert "ROS_DOMAIN_ID is '500'" in err
