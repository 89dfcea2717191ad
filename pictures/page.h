// A picture with its title, scalar bar and outline: ready for a paper.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "base/error.h"
#include "base/math.h"
#include "pictures/image.h"
#include "scene/scene.h"

namespace splatvol {

/// A scalar bar beside a picture.
struct PageBar {
  std::string label;  // over it: name and unit
  TransferFunction function;
};

/// What is round a picture.
struct PageText {
  std::string title;  // empty: none
  std::vector<PageBar> bars = {};
  int ticks = ScalarBar().ticks;  // of each bar, as in ScalarBar
};

/// Returns a title that tells the time of a step, behind other words if there are some.
[[nodiscard]] std::string title_with_time(const std::string& title, double time);

/// The sizes of a page in pixels. The title is over the picture, and scalar bars are right of it, so that nothing
/// covers the volume.
struct Page {
  int width = 0, height = 0;  // of the whole
  int top = 0;                // of the picture; it is at the left
  int picture_width = 0, picture_height = 0;
  double text_height = 12;  // of a line

  [[nodiscard]] bool operator==(const Page&) const = default;
};

/// Lays out a page of this size. Fails if its words leave less than half of each side to the picture.
[[nodiscard]] Result<Page> lay_out_page(int width, int height, const PageText& text);

/// Returns the page with its picture, which must have the page's picture_width and picture_height.
/// `halo`: words and lines beside it stand out from any background: a soft edge of the opposite colour is round them.
[[nodiscard]] Result<Image> compose_page(const Page& page, Image picture, const PageText& text, const dvec3& ink,
                                         bool halo = false);

}  // namespace splatvol
