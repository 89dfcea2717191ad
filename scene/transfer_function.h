// The pieces of a transfer function (splatvol/transfer_function.h).
#pragma once

#include <vector>

#include "base/math.h"
#include "splatvol/transfer_function.h"

namespace splatvol {

/// How values look: the transfer function of the attribute that is shown, and the factor on its extinction by the
/// values of another attribute. Refers to both.
struct Transfer {
  // Implicit: most scenes have one function only.
  Transfer(const TransferFunction& shown, const TransferFunction* factor = nullptr)
      : function(shown), opacity(factor) {}

  const TransferFunction& function;
  const TransferFunction* opacity;  // SceneOpacity::function; null: the factor is 1
};

/// Returns the t of every control point, clamped to [0, 1], with 0 and 1: rising, no two equal. Between two neighbours
/// the function is linear.
[[nodiscard]] std::vector<double> bends(const TransferFunction& function);

/// An interval of t in which colour and extinction are linear.
struct LinearPiece {
  double begin, end;
  glm::dvec4 at_begin, at_end;  // colour, extinction: limits from inside the piece
};

/// Returns the pieces of [0, 1] in order. Bends closer together than 1e-9 are one jump.
[[nodiscard]] std::vector<LinearPiece> linear_pieces(const TransferFunction& function);

}  // namespace splatvol
