// Why a picture shows nothing.
#pragma once

#include "format/volume.h"
#include "scene/scene.h"
#include "streamer/splats/visibility.h"

namespace splatvol {

/// A reason, and what to do about it. Sentences without a first capital and a full stop; empty: no reason is known.
struct EmptyReason {
  const char* reason = "";
  const char* remedy = "";

  [[nodiscard]] explicit operator bool() const { return *reason != 0; }
};

/// Finds out from the scene alone why a view shows nothing of the material in `bounds`.
[[nodiscard]] EmptyReason why_empty(const View& view, const Transfer& transfer, const ShownAttributes& attributes,
                                    const Box& bounds);

/// Finds out whether the points of a file stand for any material: they do not if all of their cells are flat. Reads
/// some hundred KiB. Fails if the file cannot be read.
[[nodiscard]] Result<EmptyReason> why_without_material(const format::Volume& volume);

/// The reason if the others know none: no splat of the view has a visible value, or they are all too faint.
[[nodiscard]] EmptyReason why_empty_in_view(bool has_splats);

}  // namespace splatvol
