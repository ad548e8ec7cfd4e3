# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
# Ubuntu 24.04 with ROS One. URL: of its Debian repository, as ROS One's own instructions say. From the top of the sources:
#   docker build -f docker/ros_one.Dockerfile --build-arg ROS_ONE=URL -t all_in_focus .
#   docker run --init -v $PWD/demo_output:/all_in_focus/demo_output all_in_focus
FROM ubuntu:24.04
ARG ROS_ONE
ENV DEBIAN_FRONTEND=noninteractive
RUN test -n "$ROS_ONE" || { echo "give --build-arg ROS_ONE=URL of the Debian repository of ROS One" >&2; exit 1; } \
    && apt-get update && apt-get install -y --no-install-recommends ca-certificates curl \
    && curl -fsSL "$ROS_ONE/gpg.key" -o /etc/apt/keyrings/ros-one-keyring.gpg \
    && . /etc/os-release \
    && echo "deb [signed-by=/etc/apt/keyrings/ros-one-keyring.gpg] $ROS_ONE $VERSION_CODENAME main" \
       > /etc/apt/sources.list.d/ros-one.list \
    && apt-get update && apt-get install -y --no-install-recommends ros-one-catkin ros-one-roscpp
COPY . /all_in_focus
WORKDIR /all_in_focus
RUN scripts/build --with-tests && rm -rf /var/lib/apt/lists/*
CMD ["scripts/demo"]
