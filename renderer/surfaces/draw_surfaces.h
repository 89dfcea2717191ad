// Surfaces as a camera sees them, and their picture together with the volume.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "pictures/image.h"
#include "renderer/surfaces/surface.h"
#include "scene/scene.h"
#include "splatvol/surface_depths.h"

namespace splatvol {

/// A surface in each pixel.
struct SurfaceLayer {
  SurfaceDepths depths;  // the volume in front of these belongs in front of the layer; infinity: all of it
  Image light;           // of the surface; its alpha is the opacity, 0 where the pixel has no further surface
};

/// Surfaces in a view, the nearest first.
struct SurfaceLayers {
  std::vector<SurfaceLayer> layers;  // none: no surface is in the picture
  bool is_joined = false;            // some layers were joined, as there were too many
};

/// Most layers of translucent surfaces with a part of the volume between each two of them.
inline constexpr std::size_t most_surface_layers = 8;

/// A slice in each pixel.
struct SlicePicture {
  std::vector<double> depths;  // where the pixel's ray meets it; infinity: nowhere, or without a value there
  Image light;                 // premultiplied; its alpha is the opacity
};

/// Returns the depth at which each pixel's ray meets a slice, row after row from the top. Infinity: nowhere, outside of
/// the view's clip region, or behind the eye's plane. A slice in a face of the region is inside.
[[nodiscard]] std::vector<double> slice_depths(const View& view, const Plane& plane);

/// Colours a slice: the transfer function's colours of the values, without light. `values`: one for each depth; NaN or
/// infinity: none there. Opacities are those of the slice, not of the function.
[[nodiscard]] SlicePicture color_slice(const View& view, const Slice& slice, std::vector<double> depths,
                                       std::span<const double> values, const TransferFunction& function);

/// Draws surfaces and slices: each pixel's centre has one ray. In a pixel, layer i holds the surface that the ray meets
/// after i translucent ones, up to the nearest opaque one. Depths have double precision, rounded to single. A ray
/// through an edge or a vertex meets one of the triangles there. Nothing is drawn behind the eye's plane, or outside of
/// the clip region. Colours are lit as by `Lighting`, with the angle between ray and triangle; edges are dark lines
/// about a pixel wide. Triangles on the near side have the opacity that Surface::opacity states.
///
/// Layers beyond `most_layers` translucent ones are joined with the last of these, in their order.
/// Works in parallel; the result does not depend on threads. Takes 24 bytes for each point, besides 36 for each pixel
/// and 20 more for each layer.
[[nodiscard]] SurfaceLayers draw_surfaces(std::span<const Surface> surfaces, std::span<const SlicePicture> slices,
                                          const View& view, std::size_t most_layers = most_surface_layers);

/// Joins layers of surfaces with the volume: add() takes each layer, with the picture of the volume in front of it.
class SurfaceComposite {
 public:
  /// `volume`: linear premultiplied RGBA, of the volume in front of the layer's depths.
  void add(const Image& volume, const SurfaceLayer& layer);

  /// Returns the picture, in linear premultiplied RGBA. Its alpha is 1 where a surface is opaque.
  [[nodiscard]] Image finish();

 private:
  Image light_;   // so far; alpha: the share of light from behind that the surfaces so far let pass
  Image volume_;  // in front of the last layer
};

}  // namespace splatvol
