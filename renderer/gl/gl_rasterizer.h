// Draws splats into a picture with OpenGL.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "base/error.h"
#include "pictures/image.h"
#include "renderer/common.h"
#include "renderer/depth_pyramid.h"
#include "renderer/gl/context.h"
#include "renderer/gl/gl_objects.h"
#include "renderer/gl/kernel.h"
#include "renderer/gl/record_pages.h"
#include "renderer/gl/target.h"
#include "renderer/gl/upsampler.h"
#include "renderer/rasterizer.h"
#include "renderer/sort.h"
#include "scene/scene.h"
#include "splat/splat.h"

namespace splatvol {

/// Keeps splats on the GPU and draws them into its own framebuffer.
///
/// Every call needs the context that was current at `create`, in the same thread. The rasterizer knows of no window: a
/// window copies the framebuffer. It sets all the OpenGL state that it depends on, and leaves it changed.
class GlRasterizer : public Rasterizer {
 public:
  /// Needs a current OpenGL 4.5 context. Fails with ErrorCode::device if there is an older one, or none.
  /// `most_bytes`: of the device, for pictures, splats and their order. `page_bytes`: of one buffer, at most.
  [[nodiscard]] static Result<std::unique_ptr<GlRasterizer>> create(KernelKind kind,
                                                                    std::uint64_t most_bytes = default_bytes,
                                                                    std::uint64_t page_bytes = default_page_bytes);

  /// The same in the context that is current, or in one of its own (renderer/device). Fails with ErrorCode::device if
  /// there is no OpenGL 4.5; `is_automatic`: also if it draws in software.
  [[nodiscard]] static Result<std::unique_ptr<Rasterizer>> make(const RasterizerOptions& options, bool is_automatic);

  static constexpr std::uint64_t default_bytes = std::uint64_t{1} << 30;
  static constexpr std::uint64_t default_page_bytes = std::uint64_t{1} << 29;

  [[nodiscard]] Status set_transfer_function(const Transfer& transfer, const DrawingUnits& units) override;
  void set_lighting(const std::optional<Lighting>& lighting) override;
  [[nodiscard]] Status set_draw_list(const DrawList& list) override;
  [[nodiscard]] Status set_surface_depths(std::shared_ptr<const SurfaceDepths> depths) override;
  [[nodiscard]] Result<FrameTimes> draw(const View& view, SortMode sort, int sample_spacing) override;
  [[nodiscard]] Capabilities capabilities() const override { return {largest_side_, false}; }
  [[nodiscard]] DevicePicture picture() const override;
  [[nodiscard]] Result<Image> read_image() const override;
  [[nodiscard]] std::uint64_t device_bytes() const override;
  [[nodiscard]] std::uint64_t plan_picture(int width, int height) override;
  [[nodiscard]] std::string description() const override;

  /// Returns the bytes of records that went up to the device so far.
  [[nodiscard]] std::uint64_t uploaded_bytes() const { return pages_.uploaded_bytes(); }

 private:
  GlRasterizer(Kernel kernel, Upsampler upsampler, std::uint64_t most_bytes, std::uint64_t page_bytes);
  [[nodiscard]] Status prepare_quads();

  // Entry and Range of records.glsl.
  struct Entry {
    std::uint32_t first, count_and_page, range;
  };
  struct Range {
    vec3 origin;
    float step, mass_scale, deviation_scale, value_scale, opacity_scale;
  };
  static_assert(sizeof(Range) == 32);  // std430 aligns vec3 to vec4
  // A range of the list. Rows of other ids are other rows.
  struct RangeKey {
    std::uint64_t shapes, values;
    std::uint32_t block, begin, count;
    [[nodiscard]] bool operator==(const RangeKey&) const = default;
  };
  [[nodiscard]] static RangeKey key_of(const DrawRange& range);
  void forget_list();
  void add_ranges(const DrawList& list);
  [[nodiscard]] Status upload_entries();
  [[nodiscard]] std::uint64_t fixed_bytes() const;
  [[nodiscard]] std::uint64_t free_bytes() const;
  [[nodiscard]] std::uint64_t padded_record_bytes() const;
  [[nodiscard]] std::uint64_t splat_bytes() const;
  [[nodiscard]] std::uint64_t list_bytes(std::uint64_t splats, std::uint64_t ranges) const;

  // Numbers of splats in drawing order, in buffers that shaders can see.
  struct Order {
    std::vector<Buffer> parts;
    std::size_t count = 0;
  };
  // An order from its beginning or from its end.
  struct Sequence {
    const Order* order;  // null: as the splats lie
    std::size_t count;
    bool from_end = false;
  };
  [[nodiscard]] Result<FrameTimes> draw_samples(const View& view, SortMode sort, const Target& target);
  [[nodiscard]] Status upload_frame(const View& view);
  void forget_surfaces();
  [[nodiscard]] Status upload_surfaces(const View& view);
  [[nodiscard]] std::uint64_t surface_bytes() const;
  [[nodiscard]] Result<Sequence> prepare_order(const View& view, SortMode sort, FrameTimes& times);
  [[nodiscard]] Result<Sequence> order_along(int axis, const View& view, FrameTimes& times);
  [[nodiscard]] Status make_order(bool by_depth, Order& order, FrameTimes& times);
  [[nodiscard]] Status compute_keys(bool by_depth);
  [[nodiscard]] Status prepare_runs(std::size_t count);
  [[nodiscard]] Status set_opacity_table(const OpacityTable& table);
  void bind_page(std::size_t page) const;
  void draw_run(const Sequence& sequence, std::size_t first, std::size_t count) const;
  void draw_quads(const Sequence& sequence) const;

  std::unique_ptr<HeadlessContext> context_;  // null: another's; the last to go
  Kernel kernel_;
  Upsampler upsampler_;
  KeySorter sorter_;
  std::uint64_t most_bytes_;
  int largest_side_;                 // of a picture
  std::uint64_t picture_bytes_ = 0;  // of the planned picture

  // The draw list.
  RecordPages pages_;
  std::vector<RangeKey> range_keys_;
  std::vector<dvec3> range_origins_;  // world units
  std::vector<Range> ranges_;
  std::vector<Entry> entries_;
  std::vector<std::uint32_t> entries_of_pages_;  // page by page
  std::vector<std::size_t> page_ends_;           // in entries_of_pages_
  Buffer entry_buffer_{"entries of the draw list"};
  Buffer page_buffer_{"entries of pages"};
  std::array<std::optional<Order>, 3> axis_orders_;  // made when first asked for

  Texture transfer_table_;
  Texture peak_table_;
  Texture opacity_table_;  // none until the first function with an opacity
  DrawingUnits units_;
  StoredAxis axis_;
  std::optional<StoredAxis> opacity_axis_;  // none: there is no opacity
  std::optional<Lighting> lighting_;

  std::shared_ptr<const SurfaceDepths> surface_depths_;
  Texture depth_texture_;  // of the surfaces, made when first drawn with
  Texture range_texture_;  // Surfaces::levels
  GLint surface_levels_ = 0;

  // The present frame.
  Buffer frame_{"frame"};
  Buffer range_buffer_{"ranges of the draw list"};
  Buffer key_buffer_{"sort keys"};
  std::vector<std::uint32_t> keys_;
  Order order_;
  std::optional<View> ordered_view_;  // of the order; none if splats or colours have changed since
  Buffer runs_{"runs of quads"};
  Buffer quads_{"quads"};
  Buffer quad_indices_{"indices of quads"};
  VertexArray vertex_array_;

  Target picture_;
  Target samples_;  // if they are farther apart than pixels
};

}  // namespace splatvol
