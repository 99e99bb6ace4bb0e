"""Other readers read our bags, and we read bags of other writers."""

import json
import os
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml
from mcap.reader import NonSeekingReader, make_reader
from mcap.writer import CompressionType, IndexType
from mcap.writer import Writer as McapLibraryWriter
from rled_msgs_py.bags import Bag, BagError, BagWriter, definitions, repair
from rled_msgs_py.bags.writer import describe
from rled_msgs_py.records import Text
from rled_msgs_py.topics import (
    CLOCK_TOPIC,
    DIAGNOSTICS,
    EE_POSE,
    JOINT_DELTA,
    JOINT_STATES,
    MARKERS,
    RECORDED,
    TARGET_POSE,
    TASK_DESCRIPTION,
)
from rosbags.highlevel import AnyReader
from rosbags.interfaces import QosDurability, QosHistory, QosReliability
from rosbags.rosbag2 import CompressionFormat, CompressionMode, Reader, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from rled_msgs_py import messages

from .samples import PERIOD, TASK, URDF, recording, same, tick, write_bag

TOPICS = {topic.name: topic for topic in RECORDED}


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    return write_bag(tmp_path_factory.mktemp("bags") / "demo", ticks=30, metadata={"seed": "7", "note": "a: [b]\nü"})


def written():
    return [("/" + topic.name, messages.encode(topic, record)) for topic, record in recording(30)]


@pytest.mark.parametrize("kind", [make_reader, NonSeekingReader])
def test_the_mcap_library_reads_the_same_bytes_and_finds_the_checksums_right(path, kind):
    with (path / "demo_0.mcap").open("rb") as file:
        read = [(channel.topic, message.data) for _, channel, message in kind(file, validate_crcs=True).iter_messages()]
    assert read == written()


def test_the_mcap_library_finds_checksums_counts_and_names(path):
    with (path / "demo_0.mcap").open("rb") as file:
        reader = make_reader(file)
        header, summary = reader.get_header(), reader.get_summary()
        (*_, last) = reader.iter_metadata()
    assert header.profile == "ros2"
    assert header.library.startswith("rled ")
    assert summary.statistics.message_count == 2 + 5 * 30
    assert {channel.message_encoding for channel in summary.channels.values()} == {"cdr"}
    assert {schema.encoding for schema in summary.schemas.values()} == {"ros2msg"}
    assert last.name == "rosbag2"
    inside = yaml.safe_load(last.metadata["serialized_metadata"])
    assert inside == yaml.safe_load((path / "metadata.yaml").read_text())["rosbag2_bagfile_information"]


def test_rosbags_reads_the_same_bytes(path):
    with Reader(path) as reader:
        assert [(connection.topic, data) for connection, _, data in reader.messages()] == written()
        assert reader.ros_distro == "jazzy"


def test_rosbags_decodes_with_the_definitions_in_the_bag(path):
    with AnyReader([path]) as reader:
        read = [
            (connection.topic, reader.deserialize(data, connection.msgtype))
            for connection, _, data in reader.messages()
        ]
    states = [message for topic, message in read if topic == "/joint_states"]
    expected = [tick(k)[0][1] for k in range(30)]
    assert [tuple(message.name) for message in states] == [record.names for record in expected]
    assert np.array_equal([message.position for message in states], [record.position for record in expected])
    assert [message.header.stamp.sec * 10**9 + message.header.stamp.nanosec for message in states] == [
        record.stamp for record in expected
    ]


def test_rosbags_finds_quality_of_service_and_type_hashes(path):
    store = get_typestore(Stores.ROS2_JAZZY)
    with Reader(path) as reader:
        for connection in reader.connections:
            topic, (qos,) = TOPICS[connection.topic[1:]], connection.ext.offered_qos_profiles
            assert (qos.history, qos.depth) == (QosHistory.KEEP_LAST, topic.qos.depth)
            assert qos.reliability == QosReliability[topic.qos.reliability.upper()]
            assert qos.durability == QosDurability[topic.qos.durability.upper()]
            assert connection.msgtype == topic.type
            assert connection.digest == store.hash_rihs01(topic.type)


def test_metadata_has_every_field_of_version_9(path):
    found = yaml.safe_load((path / "metadata.yaml").read_text())
    assert list(found) == ["rosbag2_bagfile_information"]
    found = found["rosbag2_bagfile_information"]
    (joint_states,) = [
        each for each in found["topics_with_message_count"] if each["topic_metadata"]["name"] == "/joint_states"
    ]
    forever = {"sec": 9223372036, "nsec": 854775807}
    extent = {"starting_time": {"nanoseconds_since_epoch": 0}, "duration": {"nanoseconds": 29 * PERIOD}}
    assert joint_states == {
        "topic_metadata": {
            "name": "/joint_states",
            "type": "sensor_msgs/msg/JointState",
            "serialization_format": "cdr",
            "offered_qos_profiles": [
                {
                    "history": "keep_last",
                    "depth": 10,
                    "reliability": "reliable",
                    "durability": "transient_local",
                    "deadline": forever,
                    "lifespan": forever,
                    "liveliness": "automatic",
                    "liveliness_lease_duration": forever,
                    "avoid_ros_namespace_conventions": False,
                }
            ],
            "type_description_hash": "RIHS01_a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e",
        },
        "message_count": 30,
    }
    topics = found.pop("topics_with_message_count")
    assert [each["topic_metadata"]["name"] for each in topics] == [
        "/robot_description", "/task_description", "/joint_states", "/ee_pose", "/target_pose", "/task_status",
        "/joint_delta",
    ]  # fmt: skip
    assert found == {
        "version": 9,
        "storage_identifier": "mcap",
        **extent,
        "message_count": 2 + 5 * 30,
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": ["demo_0.mcap"],
        "files": [{"path": "demo_0.mcap", **extent, "message_count": 2 + 5 * 30}],
        "custom_data": {"seed": "7", "note": "a: [b]\nü"},
        "ros_distro": "jazzy",
    }


def test_topics_without_records_are_recorded_too(tmp_path):
    store = get_typestore(Stores.ROS2_JAZZY)
    clock = store.types[CLOCK_TOPIC.type](store.types["builtin_interfaces/msg/Time"](3, 7))
    markers = store.types[MARKERS.type]([])
    with BagWriter(tmp_path / "bag") as writer:
        for topic, message in ((CLOCK_TOPIC, clock), (MARKERS, markers)):
            writer.write_cdr(topic, bytes(store.serialize_cdr(message, topic.type)), 5)
    with AnyReader([tmp_path / "bag"]) as reader:
        read = {each.topic: reader.deserialize(data, each.msgtype) for each, _, data in reader.messages()}
    assert (read["/clock"].clock.sec, read["/clock"].clock.nanosec, read["/markers"].markers) == (3, 7, [])
    bag = Bag(tmp_path / "bag")
    assert bag.counts == {"/clock": 1, "markers": 1}
    with pytest.raises(BagError, match="markers has no records"):
        list(bag.records(MARKERS))


def test_channels_carry_quality_of_service_and_type_hash(path):
    with (path / "demo_0.mcap").open("rb") as file:
        channels = make_reader(file).get_summary().channels.values()
    (channel,) = [channel for channel in channels if channel.topic == "/joint_delta"]
    assert channel.metadata["topic_type_hash"] == definitions.definition(JOINT_DELTA.type).hash
    (profile,) = yaml.safe_load(channel.metadata["offered_qos_profiles"])
    assert (profile["depth"], profile["durability"]) == (1, "volatile")


def shared_file(name):
    """A file of ROS itself, wherever it is installed."""
    prefixes = [*os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep), sys.prefix]
    return next(path for prefix in prefixes if (path := Path(prefix, "share", name)).exists())


TYPES = sorted({topic.type for topic in (*RECORDED, CLOCK_TOPIC, MARKERS, DIAGNOSTICS)})


def test_type_hashes_are_those_of_ros():
    for type_name in TYPES:
        hashes = json.loads(shared_file(f"{type_name}.json").read_text())["type_hashes"]
        known = {each["type_name"]: each["hash_string"] for each in hashes}
        assert definitions.definition(type_name).hash == known[type_name]


def test_definitions_with_the_comments_of_ros_are_the_same_definitions():
    for type_name in TYPES:
        known = json.loads(shared_file(f"{type_name}.json").read_text())
        parts = [shared_file(f"{type_name}.msg").read_text()]
        for each in known["type_description_msg"]["referenced_type_descriptions"]:
            package, _, name = each["type_name"].split("/")
            text = shared_file(f"{each['type_name']}.msg").read_text()
            parts.append(f"{'=' * 80}\nMSG: {package}/{name}\n{text}")
        text = "\n".join(parts)
        assert definitions.defines(text, type_name)
        assert not definitions.defines(
            text.replace("int32 sec", "int64 sec").replace("string data", "int32 data"), type_name
        )


def write_with_rosbags(folder, entries, mode=CompressionMode.NONE, plugin=StoragePlugin.MCAP, prefix="/"):
    writer, store = Writer(folder, version=9, storage_plugin=plugin), get_typestore(Stores.ROS2_JAZZY)
    if mode != CompressionMode.NONE:
        writer.set_compression(mode, CompressionFormat.ZSTD)
    writer.set_custom_data("seed", "7")
    connections = {}
    with writer:
        for number, (topic, record) in enumerate(entries):
            name = topic.name if topic.name.startswith("/") else prefix + topic.name
            if name not in connections:
                connections[name] = writer.add_connection(name, topic.type, typestore=store)
            writer.write(connections[name], 1_700_000_000_000_000_000 + number, messages.encode(topic, record))
    return folder


def assert_recording(bag, ticks=30):
    assert bag.task == TASK
    assert bag.robot_description == URDF
    assert bag.message_count == 2 + 5 * ticks
    assert [each.stamp for each in bag.ticks()] == [k * PERIOD for k in range(ticks)]
    assert bag.joints(JOINT_STATES).position.tolist() == [tick(k)[0][1].position.tolist() for k in range(ticks)]
    assert bag.poses(EE_POSE).position.tolist() == [tick(k)[1][1].position.tolist() for k in range(ticks)]
    assert all(map(same, bag.records(JOINT_DELTA), [tick(k)[4][1] for k in range(ticks)]))


@pytest.mark.parametrize("mode", [CompressionMode.NONE, CompressionMode.STORAGE])
def test_bags_of_rosbags_are_read(tmp_path, mode):
    bag = Bag(write_with_rosbags(tmp_path / "bag", recording(30), mode))
    assert_recording(bag)
    assert bag.metadata == {"seed": "7"}


@pytest.mark.parametrize("mode", [CompressionMode.FILE, CompressionMode.MESSAGE])
def test_a_bag_compressed_as_a_whole_is_refused_with_a_remedy(tmp_path, mode):
    path = write_with_rosbags(tmp_path / "bag", recording(2), mode)
    with pytest.raises(BagError, match=r"has the compression_mode '.*'; accepted: none, storage; convert it"):
        Bag(path)


def test_a_sqlite3_bag_is_read_like_any_other(tmp_path):
    path = write_with_rosbags(tmp_path / "bag", recording(30), plugin=StoragePlugin.SQLITE3)
    assert_recording(Bag(path))
    (file,) = path.glob("*.db3")
    assert_recording(Bag(file))


def test_a_cut_or_foreign_sqlite3_file_is_refused(tmp_path):
    path = write_with_rosbags(tmp_path / "bag", recording(30), plugin=StoragePlugin.SQLITE3)
    (file,) = path.glob("*.db3")
    data = file.read_bytes()
    for rest in (b"", data[:10], data[:5000], b"hello, this is some text"):
        file.write_bytes(rest)
        for each in (path, file):
            with pytest.raises(BagError, match=r"is empty|is no sqlite3 file|is damaged"):
                Bag(each)


def test_a_bag_in_another_storage_is_refused(tmp_path):
    path = write_with_rosbags(tmp_path / "bag", recording(2))
    text = (path / "metadata.yaml").read_text()
    (path / "metadata.yaml").write_text(text.replace("storage_identifier: mcap", "storage_identifier: other"))
    with pytest.raises(BagError, match="has the storage_identifier 'other'; accepted: mcap, sqlite3"):
        Bag(path)


def test_topics_are_found_below_the_robots_namespace(tmp_path):
    bag = Bag(write_with_rosbags(tmp_path / "bag", recording(30), prefix="/left/arm/"))
    assert_recording(bag)
    assert bag.counts["joint_states"] == 30


def test_a_bag_of_two_robots_is_refused_naming_them(tmp_path):
    store = get_typestore(Stores.ROS2_JAZZY)
    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        for name in ("/left/task_description", "/right/task_description"):
            connection = writer.add_connection(name, TASK_DESCRIPTION.type, typestore=store)
            writer.write(connection, 0, messages.encode(TASK_DESCRIPTION, Text(TASK.to_json())))
    with pytest.raises(BagError, match="several robots: /left/task_description, /right/task_description"):
        Bag(tmp_path / "bag")


MCAPS = {
    "lz4": {"compression": CompressionType.LZ4},
    "no compression": {"compression": CompressionType.NONE},
    "small chunks": {"chunk_size": 600},
    "no chunks": {"use_chunking": False},
    "no index": {"index_types": IndexType.NONE},
    "no message index": {"index_types": IndexType.ALL & ~IndexType.MESSAGE},
    "no statistics": {"use_statistics": False},
    "no checksums": {"enable_crcs": False},
    "no summary": {
        "use_statistics": False,
        "repeat_channels": False,
        "repeat_schemas": False,
        "index_types": IndexType.NONE,
        "use_summary_offsets": False,
    },
}


def write_with_mcap(path, entries, **options):
    with path.open("wb") as file:
        writer = McapLibraryWriter(file, **options)
        writer.start("ros2", "a test")
        schemas, channels = {}, {}
        for number, (topic, record) in enumerate(entries):
            described = describe(topic)
            if topic.type not in schemas:
                schemas[topic.type] = writer.register_schema(topic.type, "ros2msg", described.definition.encode())
            if topic not in channels:
                channels[topic] = writer.register_channel(described.name, "cdr", schemas[topic.type])
            writer.add_message(channels[topic], number, messages.encode(topic, record), number)
        writer.finish()
    return path


@pytest.mark.parametrize("options", MCAPS.values(), ids=MCAPS.keys())
def test_mcap_files_of_any_make_are_read(tmp_path, options):
    assert_recording(Bag(write_with_mcap(tmp_path / "a.mcap", recording(30), **options)))


@pytest.mark.parametrize("options", MCAPS.values(), ids=MCAPS.keys())
def test_mcap_files_of_any_make_are_repaired(tmp_path, options):
    path = write_with_mcap(tmp_path / "a.mcap", recording(30), **options)
    assert repair(path) == (2 + 5 * 30, [], [])
    path.write_bytes(path.read_bytes()[:-20])
    assert repair(path).messages == 2 + 5 * 30
    assert_recording(Bag(path))


def test_messages_out_of_order_are_read_in_log_order(tmp_path):
    with (tmp_path / "a.mcap").open("wb") as file:
        writer = McapLibraryWriter(file)
        writer.start("ros2", "a test")
        schema = writer.register_schema(JOINT_STATES.type, "ros2msg", describe(JOINT_STATES).definition.encode())
        channel = writer.register_channel("/joint_states", "cdr", schema)
        for topic, record in (tick(k)[0] for k in (2, 0, 1)):
            writer.add_message(channel, record.stamp, messages.encode(topic, record), 0)
        writer.finish()
    bag = Bag(tmp_path / "a.mcap")
    assert [record.stamp for record in bag.records(JOINT_STATES)] == [0, PERIOD, 2 * PERIOD]
    assert bag.joints(JOINT_STATES).stamps.tolist() == [0, PERIOD, 2 * PERIOD]
    assert bag.joints(JOINT_STATES).position[:, 0].tolist() == [0.0, 0.01, 0.02]


def foreign(path, type_name, encoding, schema_encoding, definition):
    with path.open("wb") as file:
        writer = McapLibraryWriter(file)
        writer.start("", "a test")
        schema = writer.register_schema(type_name, schema_encoding, definition)
        writer.add_message(writer.register_channel("/joint_states", encoding, schema), 0, b"{}", 0)
        writer.finish()
    return path


DEFINITION = describe(JOINT_STATES).definition
FOREIGN = {
    "json": ("sensor_msgs/msg/JointState", "json", "jsonschema", b"{}"),
    "another type": ("sensor_msgs/msg/Imu", "cdr", "ros2msg", b"float64 x"),
    "another definition": (JOINT_STATES.type, "cdr", "ros2msg", DEFINITION.replace("float64[]", "float32[]").encode()),
    "no definition": (JOINT_STATES.type, "cdr", "ros2msg", b""),
    "a broken definition": (JOINT_STATES.type, "cdr", "ros2msg", b"\xff\x00 nonsense"),
    "an unknown definition language": (JOINT_STATES.type, "cdr", "protobuf", b"?"),
}


@pytest.mark.parametrize("parts", FOREIGN.values(), ids=FOREIGN.keys())
def test_messages_of_another_make_are_refused_naming_the_topic_or_type(tmp_path, parts):
    bag = Bag(foreign(tmp_path / "a.mcap", *parts))
    for read in (lambda: list(bag.records(JOINT_STATES)), lambda: bag.joints(JOINT_STATES)):
        with pytest.raises(BagError, match=r"joint_states|JointState"):
            read()


def test_a_missing_description_is_an_error_with_a_remedy(tmp_path):
    with BagWriter(tmp_path / "bag") as writer:
        writer.write(TARGET_POSE, tick(0)[2][1])
    bag = Bag(tmp_path / "bag")
    for name in ("task", "robot_description"):
        with pytest.raises(BagError, match=f"holds no {name}.*; record it again"):
            getattr(bag, name)


def test_a_description_that_is_no_task_is_an_error_naming_the_bag(tmp_path):
    with BagWriter(tmp_path / "bag") as writer:
        writer.write(TASK_DESCRIPTION, Text("{}"))
    with pytest.raises(BagError, match="bag: the task description has other fields"):
        _ = Bag(tmp_path / "bag").task
