// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

// record_oni URI FILE FRAMES MIRRORED: records a camera's depth at 640x480 with OpenNI2's own recorder, which
// loses the first image.

#include <OpenNI.h>

#include <cstdio>
#include <string>

namespace {

bool record(const std::string& uri, const std::string& path, int frames, bool mirrored) {
  openni::Device device;
  openni::VideoStream depth;
  if (device.open(uri.c_str()) != openni::STATUS_OK ||
      depth.create(device, openni::SENSOR_DEPTH) != openni::STATUS_OK)
    return false;
  openni::VideoMode mode = depth.getVideoMode();
  mode.setResolution(640, 480);
  mode.setFps(30);
  depth.setVideoMode(mode);
  depth.setMirroringEnabled(mirrored);
  device.setImageRegistrationMode(openni::IMAGE_REGISTRATION_OFF);

  openni::Recorder recorder;
  if (recorder.create(path.c_str()) != openni::STATUS_OK || recorder.attach(depth) != openni::STATUS_OK ||
      recorder.start() != openni::STATUS_OK || depth.start() != openni::STATUS_OK)
    return false;
  openni::VideoFrameRef frame;
  for (int i = 0; i < frames; ++i) {
    if (depth.readFrame(&frame) != openni::STATUS_OK) return false;
  }
  recorder.stop();
  recorder.destroy();
  depth.stop();
  depth.destroy();
  return true;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 5) return 2;
  openni::OpenNI::initialize();
  const bool ok = record(argv[1], argv[2], std::atoi(argv[3]), std::atoi(argv[4]) != 0);
  if (!ok) std::fprintf(stderr, "record_oni: %s\n", openni::OpenNI::getExtendedError());
  openni::OpenNI::shutdown();
  return ok ? 0 : 1;
}
