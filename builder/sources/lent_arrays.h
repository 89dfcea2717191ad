// Values of a piece that stay in their arrays.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <utility>
#include <vector>

#include "builder/sources/data_set.h"
#include "builder/sources/source.h"

namespace splatvol {

/// Lends arrays, and columns that were made from arrays. Holds the arrays, not their data set.
class LentArrays final : public LentValues {
 public:
  /// `kept`: the elements of the arrays that are points of the piece, in their order.
  LentArrays(MissingValues missing, std::vector<std::uint32_t> kept);

  /// Adds the next attribute: a component of an array, or its magnitude (ArrayAttribute::magnitude). Counts the finite
  /// numbers that stand for none.
  void add(std::shared_ptr<const NumberArray> array, int component);

  /// Adds the next attribute, with a value for each point.
  void add(std::vector<double> values) { columns_.push_back({nullptr, 0, std::move(values)}); }

  /// The number of missing values of the attribute that was added last, if it is an array's. The components of a
  /// vector mostly lack the same values, so the largest of their counts is that of the vector.
  [[nodiscard]] std::uint64_t fills() const { return fills_; }

  void get(std::size_t attribute, std::span<const std::uint32_t> points, std::span<double> values) const override;
  [[nodiscard]] std::uint64_t bytes() const override;

 private:
  struct Column {
    std::shared_ptr<const NumberArray> array;  // null: made
    int component;
    std::vector<double> made;  // [point]
  };

  std::uint64_t read(const Column& column, int component, std::span<const std::uint32_t> elements,
                     std::span<double> values) const;
  void count_fills(const Column& column);

  MissingValues missing_;
  std::vector<std::uint32_t> kept_;
  std::vector<Column> columns_;  // [attribute]
  std::uint64_t fills_ = 0;
};

}  // namespace splatvol
