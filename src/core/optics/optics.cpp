// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause

#include "all_in_focus/optics.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/core.hpp>
#include <stdexcept>

namespace all_in_focus::core {
namespace {

void require(double value, const OpticsRange& range, const char* what) {
  if (range.contains(value)) return;
  throw std::invalid_argument(
      cv::format("optics: %s must be %g to %g, not %g", what, range.min, range.max, value));
}

// F CoC u^2: the numerator of equations 9 and 10.
double dofNumerator(const Optics& optics, double u_mm) {
  return optics.aperture * optics.circle_of_confusion_mm * u_mm * u_mm;
}

}  // namespace

bool operator==(const Optics& a, const Optics& b) {
  return a.focal_length_mm == b.focal_length_mm && a.aperture == b.aperture &&
         a.circle_of_confusion_mm == b.circle_of_confusion_mm;
}

void validate(const Optics& optics) {
  require(optics.focal_length_mm, kFocalLengthRange, "focal length (mm)");
  require(optics.aperture, kApertureRange, "aperture (f-number)");
  require(optics.circle_of_confusion_mm, kCircleOfConfusionRange, "circle of confusion (mm)");
}

double hyperfocalDistance(const Optics& optics) {
  return optics.focal_length_mm * optics.focal_length_mm / (optics.aperture * optics.circle_of_confusion_mm);
}

double backDof(const Optics& optics, double u_mm) {
  const double f2 = optics.focal_length_mm * optics.focal_length_mm;
  const double denominator = f2 - optics.aperture * optics.circle_of_confusion_mm * u_mm;
  if (denominator <= 0) return std::numeric_limits<double>::infinity();  // hyperfocal
  return dofNumerator(optics, u_mm) / denominator;
}

double frontDof(const Optics& optics, double u_mm) {
  const double f2 = optics.focal_length_mm * optics.focal_length_mm;
  return dofNumerator(optics, u_mm) / (f2 + optics.aperture * optics.circle_of_confusion_mm * u_mm);
}

double maxDof(const Optics& optics, double min_mm, double max_mm) {
  return std::max(backDof(optics, min_mm), frontDof(optics, max_mm));
}

double imageDistance(const Optics& optics, double focus_mm) {
  return 1.0 / (1.0 / optics.focal_length_mm - 1.0 / focus_mm);
}

double blurCircle(const Optics& optics, double depth_mm, double focus_mm) {
  // Lens diameter f / F times the distance between image point and sensor, over the image point's distance;
  // written in dioptres so that infinity needs no case.
  const double f = optics.focal_length_mm;
  const double lens_diameter_mm = f / optics.aperture;
  return lens_diameter_mm * imageDistance(optics, focus_mm) * std::abs(1.0 / depth_mm - 1.0 / focus_mm);
}

double dioptricMiddle(double min_mm, double max_mm) {
  return 2.0 / (1.0 / min_mm + 1.0 / max_mm);
}

const char* name(DofSpan span) {
  return span == DofSpan::kFull ? "full" : "paper";
}

DofSpan parseDofSpan(const std::string& text) {
  for (const DofSpan span : {DofSpan::kPaper, DofSpan::kFull}) {
    if (text == name(span)) return span;
  }
  throw std::invalid_argument("DoF rule '" + text + "' is neither paper nor full");
}

}  // namespace all_in_focus::core
