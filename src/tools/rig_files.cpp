// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "rig_files.hpp"

#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <functional>
#include <limits>
#include <map>
#include <set>
#include <sstream>
#include <stdexcept>

#include "file_error.hpp"

namespace all_in_focus {
namespace {

// {focus_mm: 800,5} is read as focus_mm: 800 and a key 5 without a value. seen: where the nodes so far begin,
// because aliases may repeat one without end.
void refuseDecimalCommas(const YAML::Node& node, const std::string& path, std::set<int>& seen) {
  if (!seen.insert(node.Mark().pos).second) return;
  for (std::size_t i = 0; node.IsSequence() && i < node.size(); ++i) refuseDecimalCommas(node[i], path, seen);
  if (!node.IsMap()) return;
  for (const auto& entry : node) {
    const std::string& key = entry.first.Scalar();
    if (entry.second.IsNull() && key.find_first_of("0123456789") == 0)
      fail(path, "a number ends with '," + key + "': write a decimal point");
    refuseDecimalCommas(entry.second, path, seen);
  }
}

YAML::Node load(const std::string& path) {
  if (!std::filesystem::is_regular_file(path)) fail(path, "no such file");
  try {
    YAML::Node node = YAML::LoadFile(path);
    if (!node.IsMap()) fail(path, "holds no keys");
    std::set<int> seen;
    refuseDecimalCommas(node, path, seen);
    return node;
  } catch (const YAML::Exception& e) {
    fail(path, std::string("not YAML: ") + e.what());
  }
}

template <typename T>
T get(const YAML::Node& node, const std::string& key, const std::string& path) {
  if (!node.IsMap() || !node[key]) fail(path, "key '" + key + "' is missing");
  try {
    return node[key].as<T>();
  } catch (const YAML::Exception&) {
    fail(path, "key '" + key + "' is of the wrong type");
  }
}

// Fails for a key that is not known: nobody would read it.
void requireKeys(const YAML::Node& node, const std::vector<std::string>& known, const std::string& where) {
  if (!node.IsMap()) return;
  for (const auto& entry : node) {
    const std::string& key = entry.first.Scalar();
    if (std::find(known.begin(), known.end(), key) != known.end()) continue;
    std::string keys = known[0];
    for (std::size_t i = 1; i < known.size(); ++i) keys += ", " + known[i];
    fail(where, "'" + key + "' is none of the keys " + keys);
  }
}

std::vector<double> numbers(const YAML::Node& node, const std::string& key, std::size_t count,
                            const std::string& path) {
  auto values = get<std::vector<double>>(node, key, path);
  if (values.size() != count) {
    fail(path, "key '" + key + "' needs " + std::to_string(count) + " numbers, not " +
                   std::to_string(values.size()));
  }
  return values;
}

// Puts the path before what the core finds wrong.
template <typename Call>
auto naming(const std::string& path, const Call& call) {
  try {
    return call();
  } catch (const std::invalid_argument& e) {
    fail(path, e.what());
  }
}

// Refuses what other programs write and nothing here would use.
void requireKnownModel(const YAML::Node& node, const std::string& path) {
  const auto model = node["camera_model"] ? get<std::string>(node, "camera_model", path) : "pinhole";
  const auto lens = node["distortion_model"] ? get<std::string>(node, "distortion_model", path) : "";
  const bool is_fisheye = model == "fisheye" && lens == "equidistant";
  if (model != "pinhole" && !is_fisheye) {
    fail(path, "camera_model '" + model +
                   "' is not supported: use pinhole, or fisheye with distortion_model: equidistant (OpenCV's "
                   "fisheye model)");
  }
  for (const char* key : {"binning_x", "binning_y"}) {
    if (!node[key] || get<int>(node, key, path) <= 1) continue;
    fail(path, std::string(key) + " is not supported in a file: give the calibration of the binned pictures");
  }
}

Camera readCamera(const std::string& path) {
  const YAML::Node node = load(path);
  Camera camera;
  camera.size = {get<int>(node, "image_width", path), get<int>(node, "image_height", path)};
  const auto k = numbers(get<YAML::Node>(node, "camera_matrix", path), "data", 9, path);
  naming(path, [&] { camera.setMatrix(k.data()); });
  requireKnownModel(node, path);
  const auto model =
      node["distortion_model"] ? get<std::string>(node, "distortion_model", path) : "plumb_bob";
  const auto coefficients = node["distortion_coefficients"]
                                ? get<std::vector<double>>(node["distortion_coefficients"], "data", path)
                                : std::vector<double>();
  naming(path + ": distortion_coefficients", [&] { camera.setDistortion(model, coefficients); });
  // Where another key of the distortion is there, theirs may be misspelt.
  const auto is_distortion = [](const auto& entry) {
    return entry.first.Scalar().rfind("distortion", 0) == 0;
  };
  if (std::any_of(node.begin(), node.end(), is_distortion))
    get<YAML::Node>(node, "distortion_coefficients", path);
  naming(path, [&] { validate(camera, "this"); });
  return camera;
}

std::string nameIn(const YAML::Node& file, const char* key) {
  return file[key] && file[key].IsScalar() ? file[key].as<std::string>() : "";
}

// Refuses the pose of the colour camera in the depth camera's frame, where names of cameras and frames tell
// it.
void requireColorAsParent(const YAML::Node& pose, const std::string& folder, const std::string& path) {
  const auto isOf = [&](const char* frame, const char* file) {
    const std::string camera = nameIn(load(folder + file), "camera_name");
    return !camera.empty() && nameIn(pose, frame).rfind(camera, 0) == 0;
  };
  if (!isOf("parent_frame", "/depth.yaml") || !isOf("child_frame", "/color.yaml")) return;
  if (isOf("parent_frame", "/color.yaml") || isOf("child_frame", "/depth.yaml")) return;
  fail(path,
       "parent_frame is that of the depth camera: give the pose of the depth camera in the colour camera's "
       "frame");
}

// What files/focus_table.py does: dioptres are interpolated, beyond the table they are unknown.
std::vector<double> focusOfTable(const YAML::Node& file, const std::string& path, int count) {
  requireKeys(file, {"focus_table", "first", "step", "home"}, path);
  const int first = file["first"] ? get<int>(file, "first", path) : 0;
  const int step = file["step"] ? get<int>(file, "step", path) : 1;
  const YAML::Node table = get<YAML::Node>(file, "focus_table", path);
  if (!table.IsSequence()) fail(path, "key 'focus_table' must be a list");
  std::map<int, double> dioptres;  // by lens step
  for (std::size_t i = 0; i < table.size(); ++i) {
    const YAML::Node row = table[i];
    requireKeys(row, {"step", "mm"}, path + ": focus_table: entry " + std::to_string(i));
    const double focus = get<double>(row, "mm", path);
    if (!(focus > 0)) fail(path, cv::format("mm must be positive, not %g", focus));
    dioptres[get<int>(row, "step", path)] = 1 / focus;
  }
  if (table.size() < 2) fail(path, "focus_table: expected two steps or more");
  const auto is_monotone = [&](const auto& compare) {
    const auto wrong = [&](const auto& a, const auto& b) { return !compare(a.second, b.second); };
    return std::adjacent_find(dioptres.begin(), dioptres.end(), wrong) == dioptres.end();
  };
  if (dioptres.size() < table.size() || (!is_monotone(std::less<>()) && !is_monotone(std::greater<>())))
    fail(path, "focus_table: steps must differ, and the distances must grow or fall throughout");
  std::vector<double> focus;
  for (int index = 0; index < count; ++index) {
    const int at = first + index * step;
    const auto above = dioptres.lower_bound(at);
    const bool known = above != dioptres.end() && (above->first == at || above != dioptres.begin());
    if (!known) {
      focus.push_back(std::numeric_limits<double>::quiet_NaN());
    } else if (above->first == at) {
      focus.push_back(1 / above->second);
    } else {
      const auto below = std::prev(above);
      const double share = static_cast<double>(at - below->first) / (above->first - below->first);
      focus.push_back(1 / (below->second + share * (above->second - below->second)));
    }
  }
  return focus;
}

}  // namespace

Rig readRig(const std::string& folder) {
  if (!std::filesystem::is_directory(folder)) fail(folder, "no such rig folder");
  Rig rig;
  rig.depth = readCamera(folder + "/depth.yaml");
  rig.color = readCamera(folder + "/color.yaml");
  const std::string path = folder + "/extrinsics.yaml";
  const YAML::Node pose = load(path);
  requireColorAsParent(pose, folder, path);
  const auto t = numbers(pose, "translation", 3, path);
  const auto q = get<std::vector<double>>(pose, "rotation", path);
  if (q.size() != 4) {
    fail(path,
         "rotation: expected a unit quaternion x, y, z, w, not " + std::to_string(q.size()) + " numbers");
  }
  if (!(std::abs(std::sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]) - 1) <= 1e-3)) {
    fail(path, "rotation: expected a unit quaternion x, y, z, w");
  }
  rig.depth_to_color = naming(path, [&] {
    return RigidTransform::fromQuaternion(q[0], q[1], q[2], q[3], {t[0], t[1], t[2]});
  });
  return rig;
}

bool hasOptics(const std::string& folder) {
  return std::filesystem::is_regular_file(folder + "/optics.yaml");
}

Optics readOptics(const std::string& folder) {
  const std::string path = folder + "/optics.yaml";
  const YAML::Node node = load(path);
  const Optics optics{get<double>(node, "focal_length_mm", path), get<double>(node, "aperture", path),
                      get<double>(node, "circle_of_confusion_mm", path)};
  naming(path, [&] { validate(optics); });
  return optics;
}

Optics parseOptics(const std::string& text) {
  std::istringstream in(text);
  Optics optics;
  char comma1 = 0, comma2 = 0;
  in >> optics.focal_length_mm >> comma1 >> optics.aperture >> comma2 >> optics.circle_of_confusion_mm;
  if (!in || comma1 != ',' || comma2 != ',' || in.peek() != std::istringstream::traits_type::eof()) {
    throw std::invalid_argument("--optics: '" + text + "' is not f,F,coc in mm, as in 24,4,0.019");
  }
  validate(optics);
  return optics;
}

std::vector<double> readFocus(const std::string& path, const std::vector<std::string>& names,
                              const std::vector<std::string>& left_out, int count) {
  const YAML::Node file = load(path);
  if (file.IsMap() && file["focus_table"]) return focusOfTable(file, path, count);
  const YAML::Node frames = get<YAML::Node>(file, "frames", path);
  if (!frames.IsSequence()) fail(path, "key 'frames' must be a list");
  requireKeys(file, {"frames"}, path);
  const double unknown = std::numeric_limits<double>::quiet_NaN();
  std::vector<double> in_order;
  std::map<std::string, double> by_name;
  for (std::size_t i = 0; i < frames.size(); ++i) {
    const YAML::Node frame = frames[i];
    requireKeys(frame, {"file", "focus_mm"}, path + ": entry " + std::to_string(i));
    const bool none = frame.IsMap() && frame["focus_mm"] && frame["focus_mm"].IsNull();
    const double focus = none ? unknown : get<double>(frame, "focus_mm", path);
    if (!(focus > 0) && !std::isnan(focus))
      fail(path, cv::format("focus_mm must be positive, not %g", focus));
    in_order.push_back(focus);
    if (names.empty()) continue;
    // With or without the folder: stack/00.png is 00.png of the stack.
    const auto name = std::filesystem::path(get<std::string>(frame, "file", path)).filename().string();
    if (!by_name.emplace(name, focus).second) fail(path, "'" + name + "' is listed twice");
  }
  if (names.empty()) return in_order;
  std::vector<double> focus;
  for (const std::string& name : names) {
    const auto found = by_name.find(name);
    focus.push_back(found == by_name.end() ? unknown : found->second);
    by_name.erase(name);
  }
  for (const std::string& name : left_out) by_name.erase(name);
  if (!by_name.empty()) fail(path, "the stack holds no file '" + by_name.begin()->first + "'");
  return focus;
}

}  // namespace all_in_focus
