// Values of a piece, packed.
#pragma once

#include <cstdint>
#include <span>
#include <variant>
#include <vector>

#include "builder/sources/source.h"

namespace splatvol {

/// The values of one attribute, in single precision if that holds all of them exactly.
using PackedColumn = std::variant<std::vector<float>, std::vector<double>>;

/// Packs values; NaN stays NaN.
[[nodiscard]] PackedColumn pack_column(std::span<const double> values);

/// Lends the values that it holds.
class HeldValues final : public LentValues {
 public:
  /// `columns`: [attribute], each with a value for each point of the piece.
  explicit HeldValues(std::vector<PackedColumn> columns) : columns_(std::move(columns)) {}

  void get(std::size_t attribute, std::span<const std::uint32_t> points, std::span<double> values) const override;

 private:
  std::vector<PackedColumn> columns_;
};

}  // namespace splatvol
