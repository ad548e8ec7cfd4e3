// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <functional>
#include <map>
#include <mutex>
#include <opencv2/imgcodecs.hpp>
#include <stdexcept>
#include <thread>

#include "image_files.hpp"
#include "output_files.hpp"
#include "quiet_stderr.hpp"
#include "read_ahead.hpp"
#include "report_json.hpp"
#include "rig_files.hpp"
#include "stack_reader.hpp"
#include "tiff_pages.hpp"

namespace fs = std::filesystem;
using namespace all_in_focus;
using namespace all_in_focus::core;

namespace {

class Files : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = fs::temp_directory_path() /
              ("all_in_focus_" + std::string(testing::UnitTest::GetInstance()->current_test_info()->name()));
    fs::remove_all(folder_);
    fs::create_directories(folder_);
  }
  void TearDown() override { fs::remove_all(folder_); }

  std::string path(const std::string& name) const { return (folder_ / name).string(); }
  void write(const std::string& name, const std::string& text) const { std::ofstream(path(name)) << text; }
  void writeRig() const {
    const std::string camera =
        "image_width: 640\nimage_height: 480\ncamera_matrix: {rows: 3, cols: 3, data: [500.0, 0, 320, 0, "
        "510.0, 240, 0, 0, 1]}\ndistortion_model: plumb_bob\ndistortion_coefficients: {rows: 1, cols: 5, "
        "data: [0.1, -0.2, 0.001, 0.002, 0.05]}\n";
    write("depth.yaml", camera);
    write("color.yaml", camera);
    write("extrinsics.yaml", "translation: [0.01, -0.02, 0.03]\nrotation: [0, 0, 0, 1]\n");
    write("optics.yaml", "focal_length_mm: 24.0\naperture: 4.0\ncircle_of_confusion_mm: 0.019\n");
  }

  fs::path folder_;
};

// The one line names the file and what is wrong.
void expectError(const std::function<void()>& call, const std::string& part) {
  try {
    call();
    ADD_FAILURE() << "no error, expected: " << part;
  } catch (const std::invalid_argument& e) {
    EXPECT_NE(std::string(e.what()).find(part), std::string::npos) << e.what();
    EXPECT_EQ(std::string(e.what()).find('\n'), std::string::npos);
  }
}

TEST_F(Files, ReadsARig) {
  writeRig();
  const Rig rig = readRig(folder_.string());
  EXPECT_EQ(rig.depth.size, cv::Size(640, 480));
  EXPECT_EQ(rig.color.fy, 510);
  EXPECT_EQ(rig.color.distortion[4], 0.05);
  EXPECT_EQ(rig.depth_to_color.translation_mm, cv::Vec3d(10, -20, 30));
  EXPECT_EQ(readOptics(folder_.string()), Optics());
}

TEST_F(Files, DistortionMayBePaddedWithZeros) {
  writeRig();
  write(
      "depth.yaml",
      "image_width: 640\nimage_height: 480\ncamera_matrix: {data: [500.0, 0, 320, 0, 510.0, 240, 0, 0, 1]}\n"
      "distortion_model: plumb_bob\ndistortion_coefficients: {data: [0, 0, 0, 0, 0, 0, 0, 0]}\n");
  EXPECT_FALSE(readRig(folder_.string()).depth.distorted());
}

TEST_F(Files, CalibrationsOfOtherProgramsAreRefusedWhereTheyWouldBeIgnored) {
  const auto camera = [&](const std::string& lines,
                          const std::string& matrix = "500.0, 0, 320, 0, 510.0, 240, 0, 0, 1") {
    write("color.yaml",
          "image_width: 640\nimage_height: 480\ncamera_matrix: {data: [" + matrix + "]}\n" + lines);
    return readRig(folder_.string()).color;
  };
  writeRig();
  const std::string four = "distortion_coefficients: {data: [0.1, 0.02, 0.003, 0]}\n";
  EXPECT_EQ(camera("distortion_model: equidistant\n" + four).lens, LensModel::kEquidistant);
  EXPECT_EQ(camera("camera_model: fisheye\ndistortion_model: equidistant\n" + four).distortion[2], 0.003);
  EXPECT_EQ(camera("camera_model: pinhole\ndistortion_model: plumb_bob\n" + four).lens,
            LensModel::kPolynomial);
  expectError([&] { camera("camera_model: fisheye\n" + four); },
              "camera_model 'fisheye' is not supported: use pinhole");
  expectError([&] { camera("camera_model: fisheye\ndistortion_model: plumb_bob\n" + four); },
              "camera_model 'fisheye'");
  expectError([&] { camera("camera_model: omni\ndistortion_model: radtan\n" + four); },
              "camera_model 'omni'");
  expectError([&] { camera("distortion_model: thin_prism\n" + four); }, "distortion model \"thin_prism\"");
  expectError([&] { camera("distortion_model: thin_prism\n"); }, "distortion model \"thin_prism\"");
  expectError(
      [&] { camera("distortion_model: equidistant\ndistortion_coefficients: {data: [0, 0, 0, 0, 1]}\n"); },
      "equidistant has 4 distortion coefficients, not 5");
  expectError([&] { camera("", "500.0, 4, 320, 0, 510.0, 240, 0, 0, 1"); }, "has a skew, 4");
  expectError([&] { camera("", "500.0, 0, 320, 0, 510.0, 240, 0, 0, 2"); }, "must be fx 0 cx");
  expectError([&] { camera("binning_x: 4\n"); }, "binning_x is not supported");
}

TEST_F(Files, RigErrorsNameFileAndKey) {
  expectError([] { readRig("/nowhere"); }, "/nowhere: no such rig folder");
  writeRig();
  write("depth.yaml", "image_width: 640\nimage_height: 480\n");
  expectError([&] { readRig(folder_.string()); }, "depth.yaml: key 'camera_matrix' is missing");
  writeRig();
  write("color.yaml",
        "image_width: 640\nimage_height: 480\ncamera_matrix: {data: [0, 0, 0, 0, 0, 0, 0, 0, 0]}\n");
  expectError([&] { readRig(folder_.string()); }, "fx = 0");
  writeRig();
  write("extrinsics.yaml", "translation: [1, 2]\nrotation: [0, 0, 0, 1]\n");
  expectError([&] { readRig(folder_.string()); }, "'translation' needs 3 numbers");
  write("extrinsics.yaml", "translation: [1, 2, 3]\nrotation: [0, 0, 0, 0]\n");
  expectError([&] { readRig(folder_.string()); }, "quaternion");
  write("extrinsics.yaml", "translation: [1, 2, x]\nrotation: [0, 0, 0, 0]\n");
  expectError([&] { readRig(folder_.string()); }, "wrong type");
  write("optics.yaml", "focal_length_mm: -24.0\naperture: 4.0\ncircle_of_confusion_mm: 0.019\n");
  expectError([&] { readOptics(folder_.string()); }, "optics.yaml: optics: focal length");
  fs::remove(path("optics.yaml"));
  expectError([&] { readOptics(folder_.string()); }, "optics.yaml: no such file");
}

TEST_F(Files, ParsesOptics) {
  EXPECT_EQ(parseOptics("50,1.8,0.03"), (Optics{50, 1.8, 0.03}));
  for (const char* bad : {"", "24", "24,4", "24,4,0.019,1", "a,b,c", "24;4;0.019"}) {
    expectError([&] { parseOptics(bad); }, "is not f,F,coc");
  }
  expectError([] { parseOptics("0,4,0.019"); }, "focal length");
}

TEST_F(Files, ReadsFocusByNameAndByOrder) {
  write("focus.yaml", "frames: [{file: b.png, focus_mm: .inf}, {file: a.png, focus_mm: 855.0}]\n");
  const auto by_name = readFocus(path("focus.yaml"), {"a.png", "b.png", "c.png"});
  EXPECT_EQ(by_name[0], 855);
  EXPECT_TRUE(std::isinf(by_name[1]));
  EXPECT_TRUE(std::isnan(by_name[2]));
  const auto by_order = readFocus(path("focus.yaml"), {});
  EXPECT_TRUE(std::isinf(by_order[0]));
  expectError([&] { readFocus(path("focus.yaml"), {"a.png"}); }, "no file 'b.png'");
  write("focus.yaml", "frames: [{file: a.png, focus_mm: -1}]\n");
  expectError([&] { readFocus(path("focus.yaml"), {"a.png"}); }, "must be positive");
}

TEST_F(Files, AFocusTableTellsTheDistanceOfEachFrame) {
  write("table.yaml",
        "{first: 2, step: 2, focus_table: [{step: 2, mm: 500}, {step: 6, mm: 1000}, {step: 7, mm: .inf}]}");
  const auto focus = readFocus(path("table.yaml"), {"a.png"}, {}, 4);
  ASSERT_EQ(focus.size(), 4U);
  EXPECT_NEAR(focus[0], 500, 1e-9);
  EXPECT_NEAR(focus[1], 2000.0 / 3, 1e-9);  // half way in dioptres
  EXPECT_NEAR(focus[2], 1000, 1e-9);
  EXPECT_TRUE(std::isnan(focus[3]));
  write("table.yaml", "focus_table: [{step: 2, mm: -500}]");
  expectError([&] { readFocus(path("table.yaml"), {}, {}, 4); }, "mm must be positive");
}

TEST_F(Files, TruncatedImagesAreRefused) {
  cv::Mat noise(60, 80, CV_8UC3);
  cv::randu(noise, 0, 255);
  for (const char* name : {"x.png", "x.jpg"}) {
    cv::imwrite(path(name), noise);
    EXPECT_NO_THROW(readColor(path(name)));
    fs::resize_file(path(name), fs::file_size(path(name)) / 2);
    expectError([&] { readColor(path(name)); }, "is cut short");
  }
  write("text.png", "no image");
  expectError([&] { readColor(path("text.png")); }, "not an image");
  expectError([&] { readColor(path("none.png")); }, "no such file");
  expectError([&] { readColor(folder_.string()); }, "not a file");
}

TEST_F(Files, DepthIsSixteenBitsOfOneChannelAndKnownSomewhere) {
  cv::imwrite(path("d8.png"), cv::Mat(4, 4, CV_8UC1, cv::Scalar(9)));
  expectError([&] { readDepth(path("d8.png")); }, "16-bit");
  cv::imwrite(path("zero.png"), cv::Mat(4, 4, CV_16UC1, cv::Scalar(0)));
  expectError([&] { readDepth(path("zero.png")); }, "unknown (0) at every pixel");
}

TEST_F(Files, LabelMapsKeepTheirValues) {
  cv::imwrite(path("l.png"), cv::Mat((cv::Mat_<std::uint8_t>(1, 3) << 0, 255, 7)));
  EXPECT_EQ(readLabelMap(path("l.png"), -1).at<int>(0, 1), 255);
  EXPECT_EQ(readLabelMap(path("l.png"), 0).at<int>(0, 0), 0);
  EXPECT_EQ(readLabelMap(path("l.png"), 255).at<int>(0, 1), 0);
  EXPECT_EQ(readLabelMap(path("l.png"), 255).at<int>(0, 0), 1);
}

TEST_F(Files, StackInNameOrder) {
  for (const char* name : {"b.png", "a.png", "c.png"})
    cv::imwrite(path(name), cv::Mat(4, 4, CV_8UC3, cv::Scalar::all(name[0])));
  write("notes.txt", "not an image");
  write(".hidden.png", "");
  StackReader stack(folder_.string());
  cv::Mat frame;
  for (const char letter : {'a', 'b', 'c'}) {
    ASSERT_TRUE(stack.next(frame));
    EXPECT_EQ(frame.at<cv::Vec3b>(0, 0)[0], letter);
  }
  EXPECT_FALSE(stack.next(frame));
  EXPECT_TRUE(stack.notes().empty());
}

TEST_F(Files, StackTellsOfABrokenImageInItsTurn) {
  for (const char* name : {"a.png", "c.png"}) cv::imwrite(path(name), cv::Mat(4, 4, CV_8UC3));
  write("b.png", "no image");
  StackReader stack(folder_.string());
  cv::Mat frame;
  EXPECT_TRUE(stack.next(frame));
  expectError([&] { stack.next(frame); }, "b.png: not an image");
}

TEST_F(Files, ReadsAheadInOrderAndNoFartherThanTwo) {
  std::mutex mutex;
  int highest = 0;
  ReadAhead images(20, [&](int i) {
    std::this_thread::sleep_for(std::chrono::milliseconds(i % 3));
    const std::lock_guard<std::mutex> lock(mutex);
    highest = std::max(highest, i);
    return cv::Mat(1, 1, CV_8UC1, cv::Scalar(i));
  });
  cv::Mat image;
  for (int i = 0; i < 20; ++i) {
    images.get(i, image);
    EXPECT_EQ(image.at<std::uint8_t>(0, 0), i);
    const std::lock_guard<std::mutex> lock(mutex);
    EXPECT_LE(highest, i + 2);
  }
}

// How often each image is decoded, when these are asked for in turn.
std::map<int, int> timesDecoded(int count, const cv::Size& size, const std::vector<int>& asked) {
  std::mutex mutex;
  std::map<int, int> decoded;
  {
    ReadAhead images(count, [&](int i) {
      const std::lock_guard<std::mutex> lock(mutex);
      ++decoded[i];
      return cv::Mat(size, CV_8UC1, cv::Scalar(i));
    });
    cv::Mat image;
    for (const int i : asked) {
      images.get(i, image);
      EXPECT_EQ(image.at<std::uint8_t>(0, 0), i);
    }
  }  // waits for the images that are decoded ahead
  return decoded;
}

TEST_F(Files, ShortBracketsAreDecodedOnce) {
  // The reference is frame 7: the frames up to it, those before it again, the rest.
  const std::vector<int> asked = {0, 1, 2, 3, 4, 5, 6,  7,  0,  1,  2,  3,
                                  4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15};
  for (const auto& [index, times] : timesDecoded(16, {1, 1}, asked)) EXPECT_EQ(times, 1) << index;
  EXPECT_EQ(timesDecoded(17, {1, 1}, asked)[3], 2) << "of longer ones nothing is kept";
}

TEST_F(Files, FewMegabytesOfFramesAreKept) {
  std::map<int, int> decoded = timesDecoded(6, {6000, 5000}, {0, 1, 2, 3, 0, 1, 2, 3});  // 30 MB each
  EXPECT_EQ(decoded[1], 1);
  EXPECT_EQ(decoded[2], 2);
}

TEST_F(Files, NumbersInNamesCountAsNumbers) {
  cv::imwrite(path("2.png"), cv::Mat(4, 4, CV_8UC3));
  cv::imwrite(path("10.png"), cv::Mat(4, 4, CV_8UC3));
  EXPECT_EQ(StackReader(folder_.string()).names(), (std::vector<std::string>{"2.png", "10.png"}));
}

TEST_F(Files, TheOrderOfNamesDoesNotDependOnTheFolder) {
  // A minus before a number is a sign here, and what stands in its place otherwise is compared as text.
  const std::vector<std::string> names = {"x1-5.png", "x1+5.png", "x1,.png"};
  for (const std::string& name : names) cv::imwrite(path(name), cv::Mat(4, 4, CV_8UC3));
  EXPECT_EQ(StackReader(folder_.string()).names(), names);
  for (const std::string& name : names) fs::remove(path(name));
  for (auto name = names.rbegin(); name != names.rend(); ++name)
    cv::imwrite(path(*name), cv::Mat(4, 4, CV_8UC3));
  EXPECT_EQ(StackReader(folder_.string()).names(), names);
}

TEST_F(Files, TiffsAreReadAsTheyAreStored) {
  cv::Mat noise(3, 4, CV_16UC1);
  cv::randu(noise, 1, 65535);
  for (int orientation = 1; orientation <= 8; ++orientation) {
    std::string data = encodeImage("x.tif", noise);
    ASSERT_TRUE(markAsResult(data, {"", "", orientation, ""}));
    write("x.tif", data);
    EXPECT_EQ(readPhotoMetadata(path("x.tif")).orientation, orientation);
    const cv::Mat depth = readDepth(path("x.tif"), {});
    EXPECT_TRUE(depth.size() == noise.size() && cv::norm(depth, noise, cv::NORM_INF) == 0) << orientation;
  }
}

TEST_F(Files, AnEntryOfATiffWithoutAValueCountsForNothing) {
  using namespace std::string_literals;
  const std::string entry = "\0\1\x10\0\0\0\0\0\7\0\0\0"s;  // width, 8 bytes wide, 0 values
  write("x.tif", "II*\0\x08\0\0\0\2\0"s + entry + entry);
  const std::vector<TiffPage> pages = readTiffPages(path("x.tif"));
  ASSERT_EQ(pages.size(), 1u);
  EXPECT_EQ(pages[0].size, cv::Size());
}

TEST_F(Files, StackErrors) {
  expectError([&] { StackReader(folder_.string()); }, "holds no image");
  expectError([&] { StackReader(path("none.avi")); }, "no such folder or video");
  write("text.avi", "no video");
  expectError([&] { StackReader(path("text.avi")); }, "not a video");
}

TEST_F(Files, TruncatedVideoIsRefused) {
  cv::VideoWriter writer(path("v.avi"), cv::VideoWriter::fourcc('M', 'J', 'P', 'G'), 10, {64, 48});
  ASSERT_TRUE(writer.isOpened());
  cv::Mat noise(48, 64, CV_8UC3), frame;
  cv::randu(noise, 0, 255);
  for (int i = 0; i < 20; ++i) writer.write(noise);
  writer.release();
  StackReader whole(path("v.avi"));
  int frames = 0;
  while (whole.next(frame)) ++frames;
  EXPECT_EQ(frames, 20);
  fs::resize_file(path("v.avi"), fs::file_size(path("v.avi")) / 2);
  expectError([&] { StackReader(path("v.avi")); }, "cut short");
}

TEST_F(Files, OutputsAppearTogetherOrNotAtAll) {
  {
    OutputFiles outputs;
    outputs.addImage(path("a.png"), cv::Mat(4, 4, CV_8UC3));
    expectError([&] { outputs.addImage(path("b.nosuch"), cv::Mat(4, 4, CV_8UC3)); }, "b.nosuch");
  }
  EXPECT_TRUE(fs::is_empty(folder_));
  {
    OutputFiles outputs;
    outputs.addImage(path("a.png"), cv::Mat(4, 4, CV_8UC3));
    outputs.addText(path("r.json"), "{}");
    outputs.commit();
  }
  EXPECT_TRUE(fs::exists(path("a.png")));
  EXPECT_TRUE(fs::exists(path("r.json")));
  EXPECT_EQ(std::distance(fs::directory_iterator(folder_), fs::directory_iterator()), 2);
  OutputFiles outputs;
  expectError([&] { outputs.addImage(path("none/a.png"), cv::Mat(4, 4, CV_8UC3)); }, "does not exist");
}

TEST_F(Files, AnErrorWhileOutputsGetTheirNamesLeavesEveryFileAsItWas) {
  const auto write = [](const std::string& path, const char* text) { std::ofstream(path) << text; };
  const auto content = [](const std::string& path) {
    std::ifstream file(path);
    return std::string(std::istreambuf_iterator<char>(file), {});
  };
  write(path("old.json"), "old");
  {
    OutputFiles outputs;
    outputs.addText(path("new.json"), "new");
    outputs.addText(path("old.json"), "new");
    outputs.addText(path("taken.json"), "new");
    fs::create_directory(path("taken.json"));
    expectError([&] { outputs.commit(); }, "taken.json: is a folder");
  }
  EXPECT_EQ(content(path("old.json")), "old");
  EXPECT_FALSE(fs::exists(path("new.json")));
  EXPECT_EQ(std::distance(fs::directory_iterator(folder_), fs::directory_iterator()), 2);

  OutputFiles outputs;
  outputs.addText(path("old.json"), "new");
  outputs.commit();
  EXPECT_EQ(content(path("old.json")), "new");
  EXPECT_EQ(std::distance(fs::directory_iterator(folder_), fs::directory_iterator()), 2);
}

TEST_F(Files, LinesReachStderrWhileImagesAreDecoded) {
  cv::imwrite(path("a.png"), cv::Mat(400, 400, CV_8UC3, cv::Scalar::all(1)));
  std::string lines;
  testing::internal::CaptureStderr();
  std::atomic<bool> is_done{false};
  std::thread decoder([&] {
    while (!is_done) readColor(path("a.png"));
  });
  for (int i = 0; i < 2000; ++i) {
    printToStderr(std::to_string(i));
    lines += std::to_string(i) + "\n";
    std::this_thread::sleep_for(std::chrono::microseconds(10));
  }
  is_done = true;
  decoder.join();
  EXPECT_EQ(testing::internal::GetCapturedStderr(), lines);
}

TEST_F(Files, WhatIsPrintedIsOneLine) {
  testing::internal::CaptureStderr();
  printToStderr("a\nb\x1b[2J.png: no\r\timage");
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "a b [2J.png: no  image\n");
}

TEST_F(Files, ASignalLeavesNoTemporaryFile) {
  for (const int signal : {SIGINT, SIGTERM, SIGHUP}) {
    const auto write_and_end = [&] {
      OutputFiles outputs;
      outputs.addText(path("a.json"), "{}");
      raise(signal);
    };
    EXPECT_EXIT(write_and_end(), testing::KilledBySignal(signal), "");
    EXPECT_TRUE(fs::is_empty(folder_));
  }
}

TEST_F(Files, MoreRegionsThanSixteenBitsHoldAreRefused) {
  EXPECT_EQ(labels16(cv::Mat(1, 1, CV_32SC1, cv::Scalar(65535))).at<std::uint16_t>(0, 0), 65535);
  expectError([] { labels16(cv::Mat(1, 1, CV_32SC1, cv::Scalar(65536))); }, "65536 regions");
}

TEST_F(Files, InfiniteDepthOfFieldIsNullInTheReport) {
  Segmentation segmentation;
  segmentation.segments.push_back({1, 10, 8000, 9000, 8500, true});
  EXPECT_NE(segmentationReport(segmentation, {}, "paper").find("\"max_dof\": null"), std::string::npos);
}

}  // namespace
