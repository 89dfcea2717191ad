#include "scene/emission_absorption.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace splatvol {
namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();
constexpr double integration_steps_per_domain = 512;
constexpr int bent_steps_per_domain = 2048;

/// Integrals over an integration step of optical depth t, in u from 0 (front) to 1 (back).
struct StepIntegrals {
  double opacity;     // t times the integral of exp(-t u)
  double ramp;        // t times the integral of u exp(-t u)
  double correction;  // the integral of u (1 - u) exp(-t u)
};

StepIntegrals step_integrals(double t) {
  // The closed forms cancel in thin integration steps; the first term left out here is below 1e-12 of the result.
  if (t < 0.01)
    return {t * (1 - t / 2 * (1 - t / 3 * (1 - t / 4 * (1 - t / 5)))),
            t * (1.0 / 2 - t * (1.0 / 3 - t * (1.0 / 8 - t * (1.0 / 30 - t / 144)))),
            1.0 / 6 - t * (1.0 / 12 - t * (1.0 / 40 - t * (1.0 / 180 - t / 1008)))};
  const double opacity = -std::expm1(-t);
  const double transmittance = 1 - opacity;
  return {opacity, opacity / t - transmittance, (t - 2 + transmittance * (t + 2)) / (t * t * t)};
}

}  // namespace

vec4 RayLight::rgba() const { return vec4(color, -std::expm1(-depth)); }

void RayLight::add_surface(const dvec3& rgb, double opacity) {
  color += transmittance * opacity * rgb;
  depth -= std::log1p(-opacity);
  transmittance *= 1 - opacity;
}

PiecewiseTransfer::PiecewiseTransfer(const TransferFunction& function)
    : largest_step_((function.hi - function.lo) / integration_steps_per_domain) {
  for (const double t : bends(function)) breaks_.push_back(function.value_at(t));
  // On a bent axis each integration step is a piece: short enough that the function is linear in the value, too.
  if (function.axis != ValueAxis::linear) {
    for (int i = 1; i < bent_steps_per_domain; ++i)
      breaks_.push_back(function.value_at(static_cast<double>(i) / bent_steps_per_domain));
    largest_step_ = infinity;
  }
  std::ranges::sort(breaks_);
  const auto repeated = std::ranges::unique(breaks_);
  breaks_.erase(repeated.begin(), repeated.end());

  // Two samples inside a piece give its line; at the ends the functions may jump.
  const auto sample = [&](double value) { return Sample{function.color(value), function.extinction(value)}; };
  const auto extend = [](const Sample& near, const Sample& far) {
    return Sample{glm::max(1.5 * near.rgb - 0.5 * far.rgb, dvec3(0)),
                  std::max(1.5 * near.extinction - 0.5 * far.extinction, 0.0)};
  };
  const Sample below = sample(-infinity);
  const Sample above = sample(infinity);
  pieces_.push_back({-infinity, breaks_.front(), below, below, below.extinction == 0});
  for (std::size_t i = 0; i + 1 < breaks_.size(); ++i) {
    const double low = breaks_[i];
    const double high = breaks_[i + 1];
    const Sample left = sample(low + 0.25 * (high - low));
    const Sample right = sample(low + 0.75 * (high - low));
    const bool is_transparent = left.extinction == 0 && right.extinction == 0;
    pieces_.push_back({low, high, extend(left, right), extend(right, left), is_transparent});
  }
  pieces_.push_back({breaks_.back(), infinity, above, above, above.extinction == 0});
}

PiecewiseTransfer::Sample PiecewiseTransfer::Piece::sample(double value) const {
  if (low == -infinity || high == infinity) return at_low;
  const double share = (value - low) / (high - low);
  return {at_low.rgb + share * (at_high.rgb - at_low.rgb),
          at_low.extinction + share * (at_high.extinction - at_low.extinction)};
}

// Calls visit(piece, values in it, shares of the stretch at both ends), front to back.
template <class Visit>
void PiecewiseTransfer::visit_pieces(const Ends& values, const Visit& visit) const {
  const auto [first, back] = values;
  const bool ascending = first < back;
  const double span = std::abs(back - first);
  auto piece = static_cast<std::size_t>(std::ranges::upper_bound(breaks_, first) - breaks_.begin());
  for (double front = first;;) {
    const double end = ascending ? std::min(back, pieces_[piece].high) : std::max(back, pieces_[piece].low);
    const Ends shares = span == 0 ? Ends{0, 1} : Ends{std::abs(front - first) / span, std::abs(end - first) / span};
    visit(pieces_[piece], Ends{front, end}, shares);
    if (end == back) return;
    front = end;
    piece += ascending ? 1 : -1;
  }
}

void PiecewiseTransfer::add(const Ends& values, double length, RayLight& light, const Ends& factor) const {
  visit_pieces(values, [&](const Piece& piece, const Ends& in_piece, const Ends& shares) {
    const double span = std::abs(values.back - values.front);
    const double share = span == 0 ? 1 : std::abs(in_piece.back - in_piece.front) / span;
    add_in_piece(piece, in_piece, share * length, light, {factor.at(shares.front), factor.at(shares.back)});
  });
}

void PiecewiseTransfer::add(const Ends& values, const PiecewiseTransfer& opacity, const Ends& opacity_values,
                            double length, RayLight& light) const {
  opacity.visit_pieces(opacity_values, [&](const Piece& piece, const Ends& in_piece, const Ends& shares) {
    if (piece.is_transparent) return;
    const int steps = opacity.steps_in(piece, in_piece);
    const Ends factor{piece.sample(in_piece.front).extinction, piece.sample(in_piece.back).extinction};
    for (int step = 0; step < steps; ++step) {
      const Ends part{static_cast<double>(step) / steps, static_cast<double>(step + 1) / steps};
      const Ends share{shares.at(part.front), shares.at(part.back)};
      add({values.at(share.front), values.at(share.back)}, (share.back - share.front) * length, light,
          {factor.at(part.front), factor.at(part.back)});
    }
  });
}

int PiecewiseTransfer::steps_in(const Piece& piece, const Ends& values) const {
  const bool is_constant = piece.low == -infinity || piece.high == infinity;
  return is_constant ? 1
                     : std::max(1, static_cast<int>(std::ceil(std::abs(values.back - values.front) / largest_step_)));
}

void PiecewiseTransfer::add_in_piece(const Piece& piece, const Ends& values, double length, RayLight& light,
                                     const Ends& factor) const {
  if (piece.is_transparent || length == 0) return;
  const Sample first = piece.sample(values.front), last = piece.sample(values.back);
  const int steps = steps_in(piece, values);
  const dvec3 rgb_step = (last.rgb - first.rgb) / static_cast<double>(steps);
  const double extinction_step = (last.extinction - first.extinction) / steps;
  dvec3 rgb = first.rgb;
  double extinction = first.extinction;
  Sample near{rgb, extinction * factor.front};
  for (int step = 0; step < steps; ++step) {
    rgb += rgb_step;
    extinction = std::max(extinction + extinction_step, 0.0);
    const Sample far{rgb, extinction * factor.at(static_cast<double>(step + 1) / steps)};
    add_step(near, far, length / steps, light);
    near = far;
  }
}

void PiecewiseTransfer::add_step(const Sample& front, const Sample& back, double length, RayLight& light) {
  // The optical depth up to u is t u - d u (1 - u); exp(d u (1 - u)) is taken to first order in the emission only.
  const double t = 0.5 * (front.extinction + back.extinction) * length;
  const double d = 0.5 * (back.extinction - front.extinction) * length;
  const StepIntegrals integrals = step_integrals(t);
  const double weight_back = integrals.ramp + d * integrals.correction;
  const double weight_front = integrals.opacity - weight_back;
  light.color += light.lighting * light.transmittance * (weight_front * front.rgb + weight_back * back.rgb);
  light.depth += t;
  light.transmittance *= 1 - integrals.opacity;
}

}  // namespace splatvol
