# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
# Debian 12 with its own ROS packages. From the top of the sources:
#   docker build -f docker/debian.Dockerfile -t all_in_focus .
#   docker run --init -v $PWD/demo_output:/all_in_focus/demo_output all_in_focus
FROM debian:12
COPY . /all_in_focus
WORKDIR /all_in_focus
RUN scripts/build --with-tests && rm -rf /var/lib/apt/lists/*
CMD ["scripts/demo"]
