#include "viewer/window/laid_out.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstring>
#include <span>
#include <utility>

namespace splatvol {
namespace {

constexpr unsigned full_weight = 256;

// Where a sample lies between two of a row of samples.
struct Between {
  int first, second;
  unsigned weight;  // of the second, of full_weight
};

Between between(int i, int count, int source_count) {
  const double at = std::clamp((i + 0.5) * source_count / count - 0.5, 0.0, source_count - 1.0);
  const int first = static_cast<int>(at);
  return {first, std::min(first + 1, source_count - 1), static_cast<unsigned>(std::lround((at - first) * full_weight))};
}

std::uint8_t mix(unsigned a, unsigned b, unsigned weight) {
  return static_cast<std::uint8_t>((a * (full_weight - weight) + b * weight + full_weight / 2) / full_weight);
}

// From bytes of red, green, blue and alpha to pixels with blue in the lowest byte.
void swap_red_and_blue(std::span<const std::uint8_t> bytes, std::uint32_t* pixels) {
  const std::size_t count = bytes.size() / 4;
  for (std::size_t i = 0; i < count; ++i) {
    std::uint32_t pixel;
    std::memcpy(&pixel, bytes.data() + 4 * i, 4);
    pixels[i] = (pixel & 0xFF00FF00U) | (pixel >> 16 & 0xFFU) | (pixel & 0xFFU) << 16;
  }
}

// Rows of a picture, in another width. Keeps the last two: rows are asked for from the top to the bottom.
class WideRows {
 public:
  WideRows(const EncodedPicture& picture, int width) : picture_(picture) {
    for (int x = 0; x < width; ++x) columns_.push_back(between(x, width, picture.width));
    for (Row& row : rows_) row.bytes.resize(4 * columns_.size());
  }

  [[nodiscard]] const std::uint8_t* row(int y) {
    Row& row = rows_[static_cast<std::size_t>(y % 2)];
    if (std::exchange(row.y, y) != y) stretch(y, row.bytes.data());
    return row.bytes.data();
  }

 private:
  struct Row {
    int y = -1;
    std::vector<std::uint8_t> bytes;
  };

  void stretch(int y, std::uint8_t* to) const {
    const std::uint8_t* from =
        &picture_.bytes[std::size_t{4} * static_cast<std::size_t>(y) * static_cast<std::size_t>(picture_.width)];
    for (const Between& column : columns_)
      for (int c = 0; c < 4; ++c) *to++ = mix(from[4 * column.first + c], from[4 * column.second + c], column.weight);
  }

  const EncodedPicture& picture_;
  std::vector<Between> columns_;
  std::array<Row, 2> rows_;
};

void mix_rows(const std::uint8_t* a, const std::uint8_t* b, unsigned weight, std::span<std::uint8_t> mixed) {
  for (std::size_t i = 0; i < mixed.size(); ++i) mixed[i] = mix(a[i], b[i], weight);
}

}  // namespace

void lay_out(const EncodedPicture& picture, int width, int height, bool top_first, std::vector<std::uint32_t>& pixels) {
  const auto row_pixels = static_cast<std::size_t>(width);
  pixels.resize(row_pixels * static_cast<std::size_t>(height));
  const auto place = [&](int y) {
    return &pixels[row_pixels * static_cast<std::size_t>(top_first ? y : height - 1 - y)];
  };
  if (picture.width == width && picture.height == height) {
    for (int y = 0; y < height; ++y)
      swap_red_and_blue(std::span(picture.bytes).subspan(4 * row_pixels * static_cast<std::size_t>(y), 4 * row_pixels),
                        place(y));
    return;
  }
  WideRows rows(picture, width);
  std::vector<std::uint8_t> mixed(4 * row_pixels);
  for (int y = 0; y < height; ++y) {
    const auto [first, second, weight] = between(y, height, picture.height);
    mix_rows(rows.row(first), rows.row(second), weight, mixed);
    swap_red_and_blue(mixed, place(y));
  }
}

}  // namespace splatvol
