# RLED on a real ROS 2 Jazzy: Ubuntu 24.04, Python 3.12, rclpy and messages from the distribution.
#   docker build -t rled .
#   docker run --rm -it rled
FROM ros:jazzy-ros-base AS wheels
SHELL ["/bin/bash", "-eo", "pipefail", "-c"]
# The distribution keeps one version of a package at a time, so apt's versions are not pinned (DL3008).
# PyBullet has no wheel for Python 3.12, so it is compiled here (about 8 minutes); the compiler stays in this stage.
# hadolint ignore=DL3008
RUN apt-get update \
    && apt-get install -y --no-install-recommends build-essential python3-dev python3-numpy python3-pip python3-venv \
    && rm -rf /var/lib/apt/lists/*
# ROS messages are compiled against Ubuntu's NumPy, so that version replaces the one in the lock.
WORKDIR /wheels
COPY requirements.txt requirements.lock ./
RUN grep -v '^ros-' requirements.txt > wanted.txt \
    && grep -vE '^(ros-|numpy==)' requirements.lock > pins.txt \
    && python3 -c 'import numpy; print(f"numpy=={numpy.__version__}")' >> pins.txt
# PyTorch's own index has the build without CUDA; an empty argument takes PyPI's build, with CUDA.
ARG TORCH_INDEX=https://download.pytorch.org/whl/cpu
RUN python3 -m venv /tmp/build \
    && PIP_EXTRA_INDEX_URL="$TORCH_INDEX" /tmp/build/bin/pip wheel --no-cache-dir -r wanted.txt -c pins.txt

FROM ros:jazzy-ros-base
SHELL ["/bin/bash", "-eo", "pipefail", "-c"]
# hadolint ignore=DL3008
RUN apt-get update \
    && apt-get install -y --no-install-recommends python3-numpy python3-pip python3-venv \
    && rm -rf /var/lib/apt/lists/* \
    && python3 -m venv --system-site-packages /opt/rled
RUN --mount=type=bind,from=wheels,source=/wheels,target=/wheels \
    /opt/rled/bin/pip install --no-cache-dir --no-index --find-links /wheels -r /wheels/wanted.txt -c /wheels/pins.txt

WORKDIR /rled
COPY rled_msgs_py rled_msgs_py
COPY rled_sim rled_sim
COPY rled_agent rled_agent
COPY rled_teleop rled_teleop
COPY ros_ws ros_ws
COPY bags bags
COPY docker/entrypoint.sh /rled/entrypoint.sh
# colcon runs with the Python that has the wheels, and writes that Python into the executables.
WORKDIR /rled/ros_ws
RUN source /opt/ros/jazzy/setup.bash \
    && /opt/rled/bin/python "$(command -v colcon)" build \
    && source install/setup.bash \
    && ros2 pkg prefix rled_bringup \
    && ros2 run rled_sim sim_node --help

RUN useradd --uid 1001 --create-home rled && install -d -o rled /rled/out
USER 1001
WORKDIR /rled
ENV PATH=/opt/rled/bin:$PATH ROS_HOME=/tmp/ros MPLCONFIGDIR=/tmp/matplotlib
ENTRYPOINT ["/rled/entrypoint.sh"]
CMD ["bash"]
