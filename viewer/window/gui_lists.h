// Where the interface looks different from the frame before.
#pragma once

#include <imgui.h>

#include <span>
#include <vector>

#include "base/math.h"
#include "viewer/window/pixel_rect.h"

namespace splatvol {

/// Returns the pixels that a clip rectangle of Dear ImGui lets through. `scale`: pixels of a window unit.
[[nodiscard]] PixelRect clip_of(const ImDrawCmd& command, dvec2 scale);

/// Copies of what Dear ImGui has drawn, to be compared with the next frame.
class GuiLists {
 public:
  struct List {
    std::vector<ImDrawVert> vertices;
    std::vector<ImDrawIdx> indices;
    std::vector<ImDrawCmd> commands;

    [[nodiscard]] bool is_same(const ImDrawList& list) const;
  };

  /// Returns whether the lists of a frame differ from those kept.
  [[nodiscard]] bool differ(std::span<const ImDrawList* const> lists) const;

  void keep(std::span<const ImDrawList* const> lists);

  [[nodiscard]] const std::vector<List>& lists() const { return lists_; }

 private:
  std::vector<List> lists_;
};

/// Where the windows of the interface are, and where they change.
class GuiWindows {
 public:
  /// Returns whether the lists of a frame differ from the last ones.
  [[nodiscard]] bool differ(std::span<const ImDrawList* const> lists) const { return kept_.differ(lists); }

  /// Takes over the lists of a frame. Returns disjoint rectangles round what differs from the lists before; none where
  /// all is the same. `scale`: pixels of a window unit, the same in each call.
  [[nodiscard]] std::vector<PixelRect> take(std::span<const ImDrawList* const> lists, dvec2 scale);

  /// Returns the rectangle round each list.
  [[nodiscard]] const std::vector<PixelRect>& bounds() const { return bounds_; }

 private:
  GuiLists kept_;
  std::vector<PixelRect> bounds_;
};

}  // namespace splatvol
