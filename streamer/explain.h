// Why a picture shows nothing.
#pragma once

#include "format/volume_info.h"
#include "scene/scene.h"

namespace splatvol {

/// A reason, and what to do about it. Sentences without a first capital and a full stop; empty: no reason is known.
struct EmptyReason {
  const char* reason = "";
  const char* remedy = "";

  [[nodiscard]] explicit operator bool() const { return *reason != 0; }
};

/// Finds out from the scene alone why a view shows nothing of the material in `bounds`.
[[nodiscard]] EmptyReason why_empty(const View& view, const TransferFunction& function,
                                    const format::Attribute& attribute, const Box& bounds);

/// The reason if why_empty knows none: no splat of the view has a visible value, or they are all too faint.
[[nodiscard]] EmptyReason why_empty_in_view(bool has_splats);

}  // namespace splatvol
