// Draws splats into a picture with the processor, tile by tile.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "renderer/cpu/bins.h"
#include "renderer/cpu/frame.h"
#include "renderer/cpu/packed_table.h"
#include "renderer/depth_pyramid.h"
#include "renderer/rasterizer.h"
#include "renderer/sort.h"

namespace splatvol {

/// Largest width or height of a picture.
inline constexpr int largest_tiled_side = 16384;

/// Numbers that are written before they are read: memory that no splat needs is never touched.
template <class Element>
class Scratch {
 public:
  /// Loses all elements if it grows.
  void reserve(std::size_t count) {
    if (count <= size_) return;
    elements_ = std::make_unique_for_overwrite<Element[]>(count);
    size_ = count;
  }
  [[nodiscard]] Element* data() { return elements_.get(); }
  [[nodiscard]] std::uint64_t memory_bytes() const { return sizeof(Element) * size_; }

 private:
  std::unique_ptr<Element[]> elements_;
  std::size_t size_ = 0;
};

/// Reads the records of a draw list where they lie, and blends front to back until nothing behind can be seen. Works on
/// all processors; the picture does not depend on their number. Uses the newest instructions of the processor that it
/// knows (SSE4, AVX2, AVX-512, NEON). Not thread-safe.
class TileRasterizer final : public Rasterizer {
 public:
  explicit TileRasterizer(KernelKind kernel);
  TileRasterizer(const TileRasterizer&) = delete;
  TileRasterizer& operator=(const TileRasterizer&) = delete;
  ~TileRasterizer() override;

  [[nodiscard]] Status set_transfer_function(const Transfer& transfer, const DrawingUnits& units) override;
  void set_lighting(const std::optional<Lighting>& lighting) override;
  [[nodiscard]] Status set_draw_list(const DrawList& list) override;
  [[nodiscard]] Status set_surface_depths(std::shared_ptr<const SurfaceDepths> depths) override;
  [[nodiscard]] Result<FrameTimes> draw(const View& view, SortMode sort, int sample_spacing) override;
  [[nodiscard]] Capabilities capabilities() const override { return {largest_tiled_side, true}; }
  [[nodiscard]] DevicePicture picture() const override { return &picture_; }
  [[nodiscard]] Result<Image> read_image() const override;
  [[nodiscard]] std::uint64_t device_bytes() const override;
  [[nodiscard]] std::uint64_t plan_picture(int width, int height) override;
  [[nodiscard]] std::string description() const override;

 private:
  /// The front-to-back sequence of splats.
  struct Sequence {
    const std::uint32_t* order;  // null: the numbers themselves
    std::size_t count;
    bool from_end;

    [[nodiscard]] std::uint32_t operator[](std::size_t i) const {
      const std::size_t at = from_end ? count - 1 - i : i;
      return order ? order[at] : static_cast<std::uint32_t>(at);
    }
  };
  void prepare_tables();
  void set_view(const View& view);
  [[nodiscard]] Status prepare_surfaces(const View& view);
  void draw_samples(const View& view, SortMode sort, Image& target, FrameTimes& times);
  [[nodiscard]] Sequence sequence_of(const View& view, SortMode sort);
  [[nodiscard]] std::span<const std::uint32_t> sort_keys(KeySorter& sorter, tiles::SortKey kind);
  [[nodiscard]] const std::vector<std::uint32_t>& order_along(int axis, const View& view);
  void reserve_batch();
  double draw_batch(const Sequence& sequence, std::size_t first, Image& target);
  void project_batch(const Sequence& sequence, std::size_t first, std::size_t count);
  void draw_tiles(std::size_t slots, Image& target);
  void draw_tile(std::size_t tile, Image& target);
  [[nodiscard]] tiles::ScreenSplats screen();

  KernelKind kernel_;
  DrawingUnits units_;
  std::optional<Lighting> lighting_;
  tiles::FrameConstants frame_;
  std::optional<TransferFunction> new_function_;  // until splats are drawn with it
  tiles::PackedTable table_;
  OpacityTable opacity_;
  std::vector<float> peaks_;
  std::shared_ptr<const SurfaceDepths> surface_depths_;
  std::optional<DepthPyramid> surfaces_;  // made of the depths when first drawn with

  // The draw list.
  DrawList list_;
  std::vector<tiles::RangeInView> ranges_;
  std::vector<std::uint32_t> first_ranges_;                // of SplatNumbers
  std::array<std::vector<std::uint32_t>, 3> axis_orders_;  // made when first asked for
  std::vector<std::uint32_t> keys_;
  KeySorter sorter_;
  std::span<const std::uint32_t> order_;
  std::optional<View> ordered_view_;  // of the order; none if splats have changed since

  // Of a batch.
  std::vector<std::uint32_t> numbers_;
  std::vector<tiles::PixelBounds> bounds_;
  std::vector<tiles::Form> forms_;
  Scratch<tiles::FarSplat> far_;
  Scratch<tiles::NearSplat> near_;
  Scratch<tiles::GaussianSplat> gaussians_;
  Scratch<float> depths_of_gaussians_;
  tiles::Bins bins_;

  tiles::TileGrid grid_;
  std::vector<std::uint8_t> closed_;  // of each tile: nothing behind it can be seen
  Image picture_, samples_, sample_rows_;
};

}  // namespace splatvol
