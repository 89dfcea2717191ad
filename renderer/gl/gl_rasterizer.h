// Draws splats into a picture with OpenGL.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "base/error.h"
#include "renderer/gl/gl_objects.h"
#include "renderer/gl/kernel.h"
#include "renderer/gl/target.h"
#include "renderer/gl/upsampler.h"
#include "renderer/rasterizer.h"
#include "renderer/sort.h"
#include "scene/image.h"
#include "scene/scene.h"
#include "streamer/splat.h"

namespace splatvol {

/// Keeps splats on the GPU and draws them into its own framebuffer.
///
/// Every call needs the context that was current at `create`, in the same thread. The rasterizer knows of no window: a
/// window copies the framebuffer. It sets all the OpenGL state that it depends on, and leaves it changed.
class GlRasterizer : public Rasterizer {
 public:
  /// Needs a current OpenGL 4.5 context. Fails with ErrorCode::device if there is an older one, or none.
  [[nodiscard]] static Result<std::unique_ptr<GlRasterizer>> create(KernelKind kind);

  [[nodiscard]] Status set_transfer_function(const TransferFunction& function, const DrawingUnits& units) override;
  void set_lighting(const std::optional<Lighting>& lighting) override;
  [[nodiscard]] Status set_draw_list(const DrawList& list) override;
  [[nodiscard]] Result<FrameTimes> draw(const View& view, SortMode sort, int sample_spacing) override;
  [[nodiscard]] Result<Image> read_image() const override;
  [[nodiscard]] std::uint64_t device_bytes() const override;
  [[nodiscard]] std::string description() const override;

  /// Returns how many splats the device's shaders can see.
  [[nodiscard]] std::uint64_t max_splats() const;

  /// Returns how many splats also fit into `gpu_bytes` of the device's memory, with a picture of this size and one
  /// drawing order. 0 if the picture alone takes more.
  [[nodiscard]] std::uint64_t max_splats(int width, int height, std::uint64_t gpu_bytes) const;

  /// Returns OpenGL's name of the picture's texture, lower left pixel first. 0 before the first draw.
  [[nodiscard]] unsigned texture() const { return picture_.texture(); }

  /// Returns how many splats are resident, drawn or not.
  [[nodiscard]] std::size_t splat_count() const { return splat_count_; }

 private:
  GlRasterizer(Kernel kernel, Upsampler upsampler);
  [[nodiscard]] Status set_splats(SplatSpan splats, std::span<const SplatBatch> batches);
  [[nodiscard]] Status set_weights(std::span<const DrawRange> ranges);
  [[nodiscard]] Status prepare_quads();
  [[nodiscard]] Result<FrameTimes> draw_samples(const View& view, SortMode sort, const Target& target);
  [[nodiscard]] Status upload_frame(const View& view);
  /// Indices of splats in their buffer, in drawing order from the beginning or from the end.
  struct Order {
    Buffer* indices;  // null: as the splats lie
    std::size_t count;
    bool from_end = false;
  };
  [[nodiscard]] Result<Order> prepare_order(const View& view, SortMode sort, FrameTimes& times);
  // The transfer function's axis for stored values, as frame.glsl has it.
  struct Axis {
    float kind = 0, low = 0, inverse_domain = 0, zero = 0, unit = 1;
  };
  [[nodiscard]] static Axis axis_of(const TransferFunction& function, const DrawingUnits& units);
  [[nodiscard]] Result<Order> order_along(int axis, const View& view, FrameTimes& times);
  [[nodiscard]] Result<std::size_t> sort_keys(bool by_depth, Buffer& order, FrameTimes& times);
  [[nodiscard]] Status prepare_runs(std::size_t count);
  void draw_quads(const Order& order) const;

  Kernel kernel_;
  Upsampler upsampler_;
  KeySorter sorter_;

  // Resident until replaced.
  DrawList list_;
  std::size_t splat_count_ = 0;
  std::vector<dvec3> batch_origins_;
  std::vector<float> batch_weights_;
  Buffer splats_{"splats"};
  std::array<std::optional<Buffer>, 3> axis_orders_;  // made when first asked for
  Texture transfer_table_;
  Texture peak_table_;
  DrawingUnits units_;
  Axis axis_;
  std::optional<Lighting> lighting_;

  // Of the present frame.
  Buffer frame_{"frame"};
  Buffer origins_{"origins of batches"};
  Buffer keys_{"sort keys"};
  Buffer order_{"drawing order"};
  std::size_t ordered_count_ = 0;     // splats that the order holds
  std::optional<View> ordered_view_;  // of the order; none if splats or colours have changed since
  Buffer runs_{"runs of quads"};
  Buffer quads_{"quads"};
  Buffer quad_indices_{"indices of quads"};
  VertexArray vertex_array_;

  Target picture_;
  Target samples_;  // if they are farther apart than pixels
};

}  // namespace splatvol
