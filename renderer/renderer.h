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
#include "renderer/sort.h"
#include "renderer/target.h"
#include "renderer/upsampler.h"
#include "scene/image.h"
#include "scene/scene.h"
#include "streamer/splat.h"

namespace splatvol {

enum class SortMode {
  none,   // as the splats were given
  axis,   // back to front along the world's axis nearest to the line of sight; sorted once, whatever the views
  exact,  // back to front, by distance to the eye (perspective) or depth (orthographic)
};

inline constexpr int max_sample_spacing = 64;

/// Where a frame's time went, in seconds, each part waited for.
struct FrameTimes {
  double sort = 0;    // keys and their sorting; 0 where the last order still holds
  double upload = 0;  // what the view and the order need
  double draw = 0;    // projection and rasterisation
};

/// Splats, kept on the GPU, drawn into a framebuffer of the renderer's own in linear premultiplied RGBA, 32-bit float.
///
/// Every call needs the context that was current at `create`, in the same thread. A window copies the framebuffer; the
/// renderer itself knows of none. It sets all the OpenGL state that it depends on, and leaves it changed.
class Renderer {
 public:
  /// Needs a current OpenGL 4.5 context; fails with ErrorCode::device where there is an older one, or none.
  [[nodiscard]] static Result<std::unique_ptr<Renderer>> create(KernelKind kind);

  /// Colour and extinction of the splats; `moments` averages them over each splat's values (transfer_table.h). Fails
  /// where the function has no control points or an empty domain. Call it before the first draw. `value_offset` is what
  /// the splats' values have to be added to: only the difference to the function's domain is taken to single precision.
  [[nodiscard]] Status set_transfer_function(const TransferFunction& function, double value_offset = 0);

  /// A light at the eye, or none: colours as they are.
  void set_lighting(const std::optional<Lighting>& lighting);

  /// How many splats the device's shaders can see.
  [[nodiscard]] std::uint64_t max_splats() const;

  /// The same within `gpu_bytes` of the device's memory, for pictures of that size and one order of drawing. 0 where the
  /// picture alone takes more.
  [[nodiscard]] std::uint64_t max_splats(int width, int height, std::uint64_t gpu_bytes) const;

  /// Replaces the splats by those of `batches`, parts of `splats`, back to front where they are to be drawn with
  /// SortMode::none. They are copied, and resident until the next call. Fails where the splats are of another kernel or
  /// a batch reaches beyond them; with ErrorCode::device where the GPU cannot hold them. There are no splats then.
  [[nodiscard]] Status set_splats(SplatSpan splats, std::span<const SplatBatch> batches);

  /// Replaces the weights of the last `set_splats` by those of `batches`, which are the same otherwise; costs nothing.
  /// Fails where there are more or fewer of them.
  [[nodiscard]] Status set_weights(std::span<const SplatBatch> batches);

  /// Draws the splats as `view` sees them, on transparent black. Fails where the picture is larger than the device
  /// allows. A splat draws nothing if its value is NaN or its extinction or its batch's weight 0; `octant`, if its
  /// centre is not in front of the eye.
  ///
  /// `sample_spacing`: pixels from one sample to the next, 1 to max_sample_spacing; what lies between is interpolated.
  /// Large splats hide nothing from wide samples, and take their time by the sample.
  [[nodiscard]] Result<FrameTimes> draw(const View& view, SortMode sort, int sample_spacing = 1);

  /// The picture of the last draw; fails before the first.
  [[nodiscard]] Result<Image> read_image() const;

  /// OpenGL's name of the texture that holds it, lower left pixel first. 0 before the first draw.
  [[nodiscard]] unsigned texture() const { return picture_.texture(); }

  /// Splats that are resident, drawn or not.
  [[nodiscard]] std::size_t splat_count() const { return splat_count_; }

  /// Bytes of GPU memory held.
  [[nodiscard]] std::uint64_t gpu_bytes() const;

 private:
  Renderer(Kernel kernel, Upsampler upsampler);
  [[nodiscard]] Status prepare_quads();
  [[nodiscard]] Result<FrameTimes> draw_samples(const View& view, SortMode sort, const Target& target);
  [[nodiscard]] Status upload_frame(const View& view);
  /// Places of splats in their buffer, in drawing order from the beginning or from the end.
  struct Order {
    Buffer* places;  // null: as the splats lie
    std::size_t count;
    bool from_end = false;
  };
  [[nodiscard]] Result<Order> prepare_order(const View& view, SortMode sort, FrameTimes& times);
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
  float value_low_ = 0;
  float inverse_domain_ = 0;
  std::optional<Lighting> lighting_;

  // Of the frame.
  Buffer frame_{"frame"};
  Buffer origins_{"origins of batches"};
  Buffer keys_{"sort keys"};
  Buffer order_{"drawing order"};
  std::size_t ordered_count_ = 0;     // splats that the order holds
  std::optional<View> ordered_view_;  // whose order it is; none where splats or colours have changed since
  Buffer runs_{"runs of quads"};
  Buffer quads_{"quads"};
  Buffer quad_indices_{"indices of quads"};
  VertexArray vertex_array_;

  Target picture_;
  Target samples_;  // where they are farther apart than pixels
};

}  // namespace splatvol
