// Rows of a picture in OpenGL's order. Internal to the renderer.
#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

namespace splatvol {

/// Turns a picture upside down: OpenGL's row 0 is the lowest.
template <class Pixel>
void flip_rows(std::vector<Pixel>& pixels, int width) {
  const auto row = static_cast<std::ptrdiff_t>(width);
  auto low = pixels.begin(), high = pixels.end();
  for (; high - low >= 2 * row; low += row) {
    high -= row;
    std::swap_ranges(low, low + row, high);
  }
}

}  // namespace splatvol
