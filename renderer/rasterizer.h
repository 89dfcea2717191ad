// Draws splats into pictures: one interface for OpenGL and for the processor.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <variant>

#include "base/error.h"
#include "pictures/image.h"
#include "scene/drawing.h"
#include "scene/scene.h"
#include "splat/record.h"
#include "splat/splat.h"
#include "splatvol/surface_depths.h"

namespace splatvol {

/// The parts of a frame's time, in seconds. Each part is waited for.
struct FrameTimes {
  double sort = 0;    // keys and their sorting; 0 if the last order still holds
  double upload = 0;  // data of the view, and records that were not there
  double draw = 0;    // projection and rasterisation

  /// The work besides: pixels, or samples, in the boxes round the splats. 0: the device does not count them.
  double fragments = 0;
};

/// What a rasterizer is made for.
struct RasterizerOptions {
  KernelKind kernel = KernelKind::moments;
  std::uint64_t gpu_bytes = std::uint64_t{1} << 30;  // that OpenGL may take
  bool in_current_context = false;                   // of OpenGL; else the rasterizer makes a context of its own
};

/// What differs between rasterizers.
struct Capabilities {
  int largest_side;  // of a picture, in pixels

  /// Whether calls may come from any thread, one at a time, and end if it is interrupted (base/interruption.h). Else
  /// they come from the thread of an OpenGL context, and ignore interruptions.
  bool any_thread;
};

/// A picture in a texture of OpenGL, lower left pixel first. All is 0 before the first.
struct TexturePicture {
  unsigned name;  // of the texture
  int width, height;
};

/// A picture where its device has it, in linear premultiplied RGBA. Valid until the next one.
using DevicePicture = std::variant<const Image*, TexturePicture>;

/// Draws the splats of a draw list, in linear premultiplied RGBA of single precision.
class Rasterizer {
 public:
  virtual ~Rasterizer() = default;

  /// Sets colour and extinction of the splats; `moments` averages them over each splat's values (transfer_table.h).
  /// Call it before the first draw. `units`: of the splats that are drawn. Views, origins of blocks and the function
  /// are in world units; only their relation to the splats is rounded to single precision. The opacity counts where all
  /// splats have values of its attribute; the factor of a splat is the mean over its values. Fails if a function has no
  /// control points or an empty domain, or a factor is not in [0, 1].
  [[nodiscard]] virtual Status set_transfer_function(const Transfer& transfer, const DrawingUnits& units) = 0;

  /// Sets a light at the eye, or none: colours as they are.
  virtual void set_lighting(const std::optional<Lighting>& lighting) = 0;

  /// Sets what is drawn from now on, back to front. Holds the rows until the next call. Only rows that were not in the
  /// list before cost more than their range. Fails if the rows are of another kernel, and with ErrorCode::device if
  /// the device cannot hold them; then nothing is drawn.
  [[nodiscard]] virtual Status set_draw_list(const DrawList& list) = 0;

  /// Hides what lies behind opaque surfaces. In each pixel, a splat is drawn as far as it is in front of the surface. A
  /// splat of `octant` is flat: it is drawn where its centre is in front. `draw` then takes a sample for each pixel, as
  /// wider ones would blur the surfaces' outlines. If all splats are in front, the picture is that without surfaces, to
  /// the last bit, but for its samples.
  ///
  /// The depths hold until the next call, and must not change while they do. Null, as at first: no surfaces. Fails
  /// unless there is a depth for each pixel; then nothing changes.
  [[nodiscard]] virtual Status set_surface_depths(std::shared_ptr<const SurfaceDepths> depths) = 0;

  /// Draws the splats as `view` sees them, on transparent black. Fails if the picture is larger than the device allows,
  /// or has another size than the depths of the surfaces. Fails with ErrorCode::cancelled if it is interrupted
  /// (Capabilities). A splat draws nothing if its value is NaN, or if its extinction is 0. A splat of `octant` draws
  /// nothing either if its centre is not in front of the eye.
  ///
  /// `sample_spacing`: pixels from one sample to the next, 1 to max_sample_spacing. The pixels between are
  /// interpolated. Wide samples lose no detail of large splats, whose drawing time goes by samples.
  [[nodiscard]] virtual Result<FrameTimes> draw(const View& view, SortMode sort, int sample_spacing) = 0;

  [[nodiscard]] virtual Capabilities capabilities() const = 0;

  /// Returns the picture of the last draw; an empty one before the first.
  [[nodiscard]] virtual DevicePicture picture() const = 0;

  /// Returns a copy of the picture of the last draw. Fails before the first.
  [[nodiscard]] virtual Result<Image> read_image() const = 0;

  /// Returns bytes held on the device, besides the rows of the draw list if the device draws them where they lie.
  [[nodiscard]] virtual std::uint64_t device_bytes() const = 0;

  /// Prepares for pictures of this size. Returns how many splats the device can hold beside one; 2^32 - 1 if it
  /// knows no limit.
  [[nodiscard]] virtual std::uint64_t plan_picture(int width, int height) = 0;

  /// Returns the device in words.
  [[nodiscard]] virtual std::string description() const = 0;
};

}  // namespace splatvol
