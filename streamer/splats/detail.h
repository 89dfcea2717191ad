// The detail that a view asks for, and the finest detail that fits.
#pragma once

#include <functional>

#include "base/error.h"
#include "streamer/splats/cut.h"

namespace splatvol {

/// The first tolerance above 0 that is tried when all points do not fit.
inline constexpr double smallest_raised_tolerance = 1.0 / 16;

/// Fails with invalid_argument if a number is out of range.
[[nodiscard]] Status check_detail(const Detail& detail);

/// Raises the tolerance, or lowers the resolution or the splats of a goal. Returns false, and changes nothing, if the
/// detail is the coarsest.
[[nodiscard]] bool make_coarser(Detail& detail);

/// Whether `detail` is finer than `other`. Requires that they differ in no more than `make_coarser` changes.
[[nodiscard]] bool is_finer(const Detail& detail, const Detail& other);

/// A cut, and the detail for which it was chosen.
struct Choice {
  Cut cut;
  Detail detail;
};

/// Returns the finest choice that fits, no finer than `detail`. `try_cut` fails with out_of_budget if a detail does not
/// fit. The details that are tried depend on nothing but `detail` and what fits. Fails with the error of the coarsest
/// detail, or with any other error of `try_cut`.
[[nodiscard]] Result<Choice> choose_finest(Detail detail, const std::function<Result<Cut>(const Detail&)>& try_cut);

}  // namespace splatvol
