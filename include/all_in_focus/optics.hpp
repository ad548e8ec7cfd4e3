// SPDX-FileCopyrightText: all_in_focus contributors
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <string>

namespace all_in_focus::core {

/// Lens of the colour camera. Lengths in mm.
struct Optics {
  double focal_length_mm = 24.0;  ///< f
  double aperture = 4.0;          ///< f-number F = f / lens diameter
  double circle_of_confusion_mm =
      0.019;  ///< CoC: largest blur on the sensor that counts as sharp; delta in the paper
};

/// True if all members are equal.
bool operator==(const Optics& a, const Optics& b);

/// A range of possible values, both ends included.
struct OpticsRange {
  double min, max;
  bool contains(double value) const { return value >= min && value <= max; }  ///< false for NaN
};

// What a lens can have.
constexpr OpticsRange kFocalLengthRange{0.1, 10000};      ///< mm
constexpr OpticsRange kApertureRange{0.1, 1000};          ///< f-number
constexpr OpticsRange kCircleOfConfusionRange{1e-6, 10};  ///< mm

/// Throws std::invalid_argument that names the member unless all three are what a lens can have.
void validate(const Optics& optics);

/// Hyperfocal distance H = f^2 / (F CoC), mm. Focused at H or beyond, everything behind the focus distance is
/// sharp.
double hyperfocalDistance(const Optics& optics);

/// Depth of field behind a focus distance u (equation 9), mm; infinite from the hyperfocal distance on, where
/// the printed formula gives negative values.
double backDof(const Optics& optics, double u_mm);

/// Depth of field in front of a focus distance u (equation 10), mm.
double frontDof(const Optics& optics, double u_mm);

/// MaxDoF of a depth range: max(backDof(min), frontDof(max)), mm (section 2.2).
double maxDof(const Optics& optics, double min_mm, double max_mm);

/// Distance of the image plane behind a thin lens focused at focus_mm > f, mm. focus_mm may be infinite.
double imageDistance(const Optics& optics, double focus_mm);

/// Diameter of the blur circle on the sensor, mm, of a point at depth_mm when a thin lens is focused at
/// focus_mm: f^2 / F * |depth - focus| / (depth (focus - f)). Both may be infinite, and both must exceed f.
double blurCircle(const Optics& optics, double depth_mm, double focus_mm);

/// Focus distance in the dioptric middle of a depth range, mm: both ends are equally sharp.
double dioptricMiddle(double min_mm, double max_mm);

/// How much depth one region may span, in dioptres.
enum class DofSpan {
  kPaper,  ///< 1/H: the lens is focused on one end of the region (the rule as printed)
  kFull,   ///< 2/H: the lens is focused in the dioptric middle of the region
};

/// Its name for people: paper, full.
const char* name(DofSpan span);
/// The span of that name. Throws std::invalid_argument.
DofSpan parseDofSpan(const std::string& text);

/// The DoF rule: max - min < MaxDoF.
///
/// Both halves of the printed rule are the same bound on the dioptre span of the region:
///   diff < backDof(min)  <=>  1/min - 1/max < 1/H  <=>  diff < frontDof(max),
/// for every min and max, also beyond the hyperfocal distance. Multiplied by H min max it needs no division.
class DofRule {
 public:
  /// optics: valid, see validate().
  explicit DofRule(const Optics& optics, DofSpan span = DofSpan::kPaper)
      : hyperfocal_mm_(hyperfocalDistance(optics) / (span == DofSpan::kFull ? 2.0 : 1.0)) {}

  /// True if a region of these depths keeps the rule. 0 < min <= max, mm.
  bool fits(std::uint32_t min_mm, std::uint32_t max_mm) const {
    return (max_mm - min_mm) * hyperfocal_mm_ < static_cast<double>(min_mm) * max_mm;
  }

 private:
  double hyperfocal_mm_;
};

}  // namespace all_in_focus::core
