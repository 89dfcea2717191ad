#include "builder/sources/lent_arrays.h"

#include <algorithm>
#include <array>
#include <utility>

#include "base/hypotenuse.h"

namespace splatvol {
namespace {

constexpr std::size_t read_at_once = 1024;

}  // namespace

LentArrays::LentArrays(MissingValues missing, std::vector<std::uint32_t> kept)
    : missing_(std::move(missing)), kept_(std::move(kept)) {}

void LentArrays::add(std::shared_ptr<const NumberArray> array, int component) {
  columns_.push_back({std::move(array), component, {}});
  count_fills(columns_.back());
}

std::uint64_t LentArrays::bytes() const {
  std::uint64_t bytes = kept_.size() * sizeof(std::uint32_t);
  for (const Column& column : columns_) bytes += column.made.size() * sizeof(double);
  return bytes;
}

void LentArrays::count_fills(const Column& column) {
  const bool all = column.component == ArrayAttribute::magnitude;
  const int first = all ? 0 : column.component, end = all ? column.array->components() : first + 1;
  std::vector<double> values(read_at_once);
  fills_ = 0;
  for (int component = first; component < end; ++component) {
    std::uint64_t fills = 0;
    for (std::size_t begin = 0; begin < kept_.size(); begin += read_at_once) {
      const auto elements = std::span(kept_).subspan(begin, std::min(read_at_once, kept_.size() - begin));
      fills += read(column, component, elements, std::span(values).first(elements.size()));
    }
    fills_ = std::max(fills_, fills);
  }
}

// Reads a component; the missing ones become NaN. Returns how many of them were finite.
std::uint64_t LentArrays::read(const Column& column, int component, std::span<const std::uint32_t> elements,
                               std::span<double> values) const {
  column.array->read(component, elements, values);
  return missing_.replace(values);
}

void LentArrays::get(std::size_t attribute, std::span<const std::uint32_t> points, std::span<double> values) const {
  const Column& column = columns_[attribute];
  if (!column.array) {
    for (std::size_t i = 0; i < points.size(); ++i) values[i] = column.made[points[i]];
    return;
  }
  std::array<std::uint32_t, read_at_once> elements{};
  std::array<double, read_at_once> component{};
  for (std::size_t begin = 0; begin < points.size(); begin += read_at_once) {
    const std::size_t count = std::min(read_at_once, points.size() - begin);
    const auto of_elements = std::span(elements).first(count);
    const std::span<double> part = values.subspan(begin, count);
    for (std::size_t i = 0; i < count; ++i) of_elements[i] = kept_[points[begin + i]];
    if (column.component != ArrayAttribute::magnitude) {
      read(column, column.component, of_elements, part);
      continue;
    }
    std::ranges::fill(part, 0.0);
    for (int c = 0; c < column.array->components(); ++c) {
      read(column, c, of_elements, std::span(component).first(count));
      for (std::size_t i = 0; i < count; ++i) part[i] = hypotenuse(part[i], component[i]);
    }
  }
}

}  // namespace splatvol
