// Where integrals are taken, and sums of them.
#pragma once

#include <cstddef>
#include <limits>
#include <string>
#include <vector>

#include "base/error.h"
#include "base/math.h"
#include "format/cell_reader.h"
#include "format/volume_info.h"
#include "splatvol/integrals.h"

namespace splatvol {

/// A sum and what rounding took from it (Knuth's two-sum).
class CompensatedSum {
 public:
  void add(double number) {
    const double sum = sum_ + number, added = sum - sum_;
    rest_ += (sum_ - (sum - added)) + (number - added);
    sum_ = sum;
  }
  void add(const CompensatedSum& other) {
    add(other.sum_);
    add(other.rest_);
  }
  [[nodiscard]] double value() const { return sum_ + rest_; }

 private:
  double sum_ = 0, rest_ = 0;
};

/// Sums of an attribute's values, and their extremes. `size`: the volume or the area of the parts with a value.
struct ValueSums {
  struct Extreme {
    double value;
    dvec3 position{std::numeric_limits<double>::quiet_NaN()};
  };

  CompensatedSum size, missing, integral;
  Extreme low{std::numeric_limits<double>::infinity()};
  Extreme high{-std::numeric_limits<double>::infinity()};

  /// Adds those of a part behind all others.
  void add(const ValueSums& other);

  void look_at(double value, const dvec3& position) {
    if (value < low.value) low = {value, position};
    if (value > high.value) high = {value, position};
  }

  /// Returns what they tell, with a name and a unit.
  [[nodiscard]] ValueIntegral result(std::string name, const std::string& unit) const;
};

/// A range of values of an attribute that is read.
struct ValueLimits {
  std::size_t attribute;  // index into Tetrahedra::values
  double low, high;

  [[nodiscard]] bool contain(double value) const { return low <= value && value <= high; }
};

/// A request with the numbers of attributes.
struct IntegralRegion {
  Box box;
  std::vector<HalfSpace> half_spaces;  // the largest component of each normal is 1 or -1
  std::vector<ValueLimits> ranges;

  /// Whether a part of a box may be in the region, if positions may be wrong by `rounding`.
  [[nodiscard]] bool meets(const Box& other, double rounding) const;
};

/// Returns the distance of a position from a plane, in units of the normal; 0 where rounding may have made it.
[[nodiscard]] double distance_of(const HalfSpace& half_space, const dvec3& position);

/// Returns a plane whose normal's largest component is 1 or -1. Fails unless it has a finite point and a finite normal
/// that is not 0.
[[nodiscard]] Result<HalfSpace> scaled_plane(const HalfSpace& plane, const std::string& name);

/// Makes the region, and adds attributes of its ranges to those that are read. Fails if it is none, with the name of
/// the file.
[[nodiscard]] Result<IntegralRegion> region_of(const format::VolumeInfo& info, const IntegralRequest& request,
                                               const std::string& name, std::vector<std::size_t>& attributes);

/// The ranges by which chunks are left out: the first two of them. `attributes`: those that are read. Ranges of
/// attributes with missing values leave out nothing: what lacks a value is counted.
class VisibleChunks {
 public:
  VisibleChunks(const format::VolumeInfo& info, const std::vector<ValueLimits>& ranges,
                const std::vector<std::size_t>& attributes);

  /// Leaves out chunks without such a value. Call before all else.
  void require(std::size_t attribute, double value);

  [[nodiscard]] format::SummaryAttributes summaries() const;
  [[nodiscard]] bool operator()(const format::CellPage& page, std::size_t chunk) const;

 private:
  [[nodiscard]] bool meets(const ValueLimits& range, const format::ValueSummary& summary) const;

  const format::VolumeInfo& info_;
  std::vector<ValueLimits> ranges_;  // with indices into VolumeInfo::attributes
};

}  // namespace splatvol
