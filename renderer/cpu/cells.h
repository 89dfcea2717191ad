// Draws cells of a mesh exactly, on the processor.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "base/error.h"
#include "pictures/image.h"
#include "renderer/cell_source.h"
#include "scene/scene.h"
#include "splatvol/surface_depths.h"

namespace splatvol {

namespace tiles {
struct CellWorkspace;
}

/// A surface in each pixel.
struct CellLayer {
  const SurfaceDepths* depths = nullptr;
  const Image* light = nullptr;  // premultiplied; alpha: the opacity. Null: rays end at these depths, and show nothing
};

struct CellDrawing {
  View view;
  Transfer transfer;  // refers to functions, which must outlive the drawing
  std::optional<Lighting> lighting = {};
  Contours contours = {};
  std::vector<CellLayer> layers = {};  // of the picture's size; none lies in front of the one before it
  int sample_spacing = 1;              // as Rasterizer::draw; 1 with layers

  /// Blocks of pixels between four samples that differ by more in a channel get a sample in each pixel, in a second
  /// sweep over the chunks there. 0: none do.
  float refined_difference = 0;
  std::uint64_t memory = std::uint64_t{1} << 30;  // bytes, besides the picture, and a chunk and 4 MiB for each thread

  /// Called with the share that is done, in [0, 1], one call at a time.
  std::function<void(double)> progress = {};
};

struct CellPicture {
  Image image;                 // linear premultiplied RGBA
  std::uint64_t segments = 0;  // pieces of rays in a tetrahedron with a visible value, between two layers, and events
};

/// Returns the pieces on which a function is linear in the value: on a bent axis these are many.
[[nodiscard]] std::size_t count_pieces(const TransferFunction& function);

/// Draws exact pictures of cells, with contours and the view's slices: as render_reference()
/// (renderer/reference/reference.h), in single precision where that does not show. Keeps its memory between pictures.
/// Not thread-safe; it draws on all threads.
class CellRasterizer {
 public:
  CellRasterizer();
  ~CellRasterizer();

  /// Reads each chunk at most once, or twice for refined blocks, if what waits fits into memory, else once for each
  /// part of the picture: down to a single pixel. A chunk that lies behind opaque layers is not read. The picture does
  /// not depend on threads, memory and the order of chunks. `memory`: an image that is needed no more, whose memory the
  /// picture takes. Fails if the source fails, with `cancelled` if the thread is interrupted, and with `out_of_budget`
  /// if a pixel's segments do not fit into memory.
  [[nodiscard]] Result<CellPicture> draw(const CellSource& source, const CellDrawing& drawing, Image memory = {});

 private:
  [[nodiscard]] Status refine(const CellSource& source, const CellDrawing& drawing, CellPicture& picture);

  std::unique_ptr<tiles::CellWorkspace> workspace_;
  Image samples_, sample_rows_;  // of a picture whose samples are farther apart than pixels
};

}  // namespace splatvol
