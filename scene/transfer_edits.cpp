#include "scene/transfer_edits.h"

#include <cmath>

namespace splatvol {

double largest_extinction(const TransferFunction& function) {
  double largest = 0;
  for (const auto& density : function.densities) largest = std::max(largest, density.extinction);
  return largest;
}

TransferFunction with_domain(TransferFunction function, ValueAxis axis, double lo, double hi) {
  constexpr double least_share = 1e-6;  // a logarithmic axis shows six decades
  const double largest = std::max(std::abs(lo), std::abs(hi));
  if (axis == ValueAxis::log && !(hi > 0)) return function;
  if (axis == ValueAxis::asinh && function.axis != axis) function.linear_width = 1e-3 * largest;
  function.axis = axis;
  function.lo = axis == ValueAxis::log && !(lo > 0) ? least_share * hi : lo;
  function.hi = hi;
  return function;
}

}  // namespace splatvol
