// Draws splats into a picture with OpenGL.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "base/error.h"
#include "renderer/gl_objects.h"
#include "renderer/kernel.h"
#include "renderer/rasterizer.h"
#include "renderer/sort.h"
#include "renderer/target.h"
#include "renderer/upsampler.h"
#include "scene/image.h"
#include "scene/scene.h"
#include "streamer/splat.h"

namespace splatvol {

/// Keeps splats on the GPU and draws them into its own framebuffer, in linear premultiplied RGBA, 32-bit float.
///
/// Every call needs the context that was current at `create`, in the same thread. The renderer knows of no window: a
/// window copies the framebuffer. It sets all the OpenGL state that it depends on, and leaves it changed.
class Renderer {
 public:
  /// Needs a current OpenGL 4.5 context. Fails with ErrorCode::device if there is an older one, or none.
  [[nodiscard]] static Result<std::unique_ptr<Renderer>> create(KernelKind kind);

  /// Sets colour and extinction of the splats; `moments` averages them over each splat's values (transfer_table.h).
  /// Call it before the first draw. `units`: of the splats that are set. Views, batches' origins and the function are
  /// in world units; only their relation to the splats is rounded to single precision. Fails if the function has no
  /// control points or an empty domain.
  [[nodiscard]] Status set_transfer_function(const TransferFunction& function, const DrawingUnits& units = {});

  /// Sets a light at the eye, or none: colours as they are.
  void set_lighting(const std::optional<Lighting>& lighting);

  /// Returns how many splats the device's shaders can see.
  [[nodiscard]] std::uint64_t max_splats() const;

  /// Returns how many splats also fit into `gpu_bytes` of the device's memory, with a picture of this size and one
  /// drawing order. 0 if the picture alone takes more.
  [[nodiscard]] std::uint64_t max_splats(int width, int height, std::uint64_t gpu_bytes) const;

  /// Replaces the splats by those of `batches`, which are parts of `splats`. SortMode::none draws them in this order,
  /// so it needs them back to front. Copies the splats; they stay resident until the next call. Fails if the splats are
  /// of another kernel or a batch reaches beyond them, and with ErrorCode::device if the GPU cannot hold them. There
  /// are no splats after a failure.
  [[nodiscard]] Status set_splats(SplatSpan splats, std::span<const SplatBatch> batches);

  /// Replaces the weights of the last `set_splats` by those of `batches`, which are the same otherwise. Costs nothing.
  /// Fails if there are more or fewer batches.
  [[nodiscard]] Status set_weights(std::span<const SplatBatch> batches);

  /// Draws the splats as `view` sees them, on transparent black. Fails if the picture is larger than the device allows.
  /// A splat draws nothing if its value is NaN, or if its extinction or its batch's weight is 0. A splat of `octant`
  /// draws nothing either if its centre is not in front of the eye.
  ///
  /// `sample_spacing`: pixels from one sample to the next, 1 to max_sample_spacing. The pixels between are
  /// interpolated. Wide samples lose no detail of large splats, whose drawing time goes by samples.
  [[nodiscard]] Result<FrameTimes> draw(const View& view, SortMode sort, int sample_spacing = 1);

  /// Reads the picture of the last draw. Fails before the first.
  [[nodiscard]] Result<Image> read_image() const;

  /// Returns OpenGL's name of the picture's texture, lower left pixel first. 0 before the first draw.
  [[nodiscard]] unsigned texture() const { return picture_.texture(); }

  /// Returns how many splats are resident, drawn or not.
  [[nodiscard]] std::size_t splat_count() const { return splat_count_; }

  /// Returns the bytes of GPU memory held.
  [[nodiscard]] std::uint64_t gpu_bytes() const;

 private:
  Renderer(Kernel kernel, Upsampler upsampler);
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
