#include "renderer/cpu/cell_function.h"

#include <algorithm>
#include <cmath>

#include "renderer/common.h"

namespace splatvol::tiles {
namespace {

using glm::dvec4;

constexpr double most_error = 1e-4;  // of colour and extinction on a bent axis, as shares of the largest
constexpr double most_steps = 2048;  // of a domain on a bent axis: svtruth's

struct UPiece {
  double begin, end;
  dvec4 at_begin, at_end;

  [[nodiscard]] double width() const { return end - begin; }
  [[nodiscard]] bool shows() const { return at_begin[3] + at_end[3] > 0; }
  // Whether double precision tells places within it.
  [[nodiscard]] bool is_resolved() const { return width() > 1e-13 * std::max(std::abs(begin), std::abs(end)); }
  // The same for single precision, of distances from `origin`.
  [[nodiscard]] bool is_resolved_from(double origin) const {
    return is_resolved() && width() >= 3e-7 * std::max(std::abs(begin - origin), std::abs(end - origin));
  }
};

// Returns how far t is from being linear in the value over the domain: on a bent axis, the second derivative of the
// value by t is at most so many times the first.
double bend_of(const TransferFunction& function) {
  if (function.axis == ValueAxis::log) return std::log(function.hi / function.lo);
  return std::asinh(function.hi / function.linear_width) - std::asinh(function.lo / function.linear_width);
}

// Returns into how many steps a piece on a bent axis is cut. A step h has an error of bend h^2 / 8 in t, which the
// slope of the function turns into one of colour and extinction. `largest`: of the function.
int steps_of(const LinearPiece& piece, double bend, const dvec4& largest) {
  if (!(piece.at_begin[3] + piece.at_end[3] > 0)) return 1;
  double change = 0;
  for (int c = 0; c < 4; ++c)
    if (largest[c] > 0) change = std::max(change, std::abs(piece.at_end[c] - piece.at_begin[c]) / largest[c]);
  const double width = piece.end - piece.begin;
  const double steps = std::sqrt(bend * change * width / (8 * most_error));
  return static_cast<int>(std::ceil(std::clamp(steps, 1.0, std::max(1.0, width * most_steps))));
}

// Pieces of the domain, by u.
std::vector<UPiece> pieces_by_value(const TransferFunction& function) {
  const auto u_of = [&](double t) { return (function.value_at(t) - function.lo) / (function.hi - function.lo); };
  const std::vector<LinearPiece> linear = linear_pieces(function);
  std::vector<UPiece> pieces;
  if (function.axis == ValueAxis::linear) {
    for (const LinearPiece& piece : linear) pieces.push_back({piece.begin, piece.end, piece.at_begin, piece.at_end});
    return pieces;
  }
  const double bend = bend_of(function);
  dvec4 largest(0);
  for (const LinearPiece& piece : linear) largest = glm::max(largest, glm::max(piece.at_begin, piece.at_end));
  for (const LinearPiece& piece : linear) {
    const int steps = steps_of(piece, bend, largest);
    for (int step = 0; step < steps; ++step) {
      const double first = static_cast<double>(step) / steps, last = static_cast<double>(step + 1) / steps;
      const auto at = [&](double share) { return glm::mix(piece.at_begin, piece.at_end, share); };
      const auto t_at = [&](double share) { return piece.begin + share * (piece.end - piece.begin); };
      pieces.push_back({u_of(t_at(first)), u_of(t_at(last)), at(first), at(last)});
    }
  }
  return pieces;
}

// The denser end of the narrowest piece that shows something.
double choose_origin(const std::vector<UPiece>& pieces) {
  const UPiece* narrowest = nullptr;
  for (const UPiece& piece : pieces)
    if (piece.shows() && piece.is_resolved() && (!narrowest || piece.width() < narrowest->width())) narrowest = &piece;
  if (!narrowest) return 0;
  return narrowest->at_begin[3] > narrowest->at_end[3] ? narrowest->begin : narrowest->end;
}

}  // namespace

FunctionPieces::FunctionPieces(const TransferFunction& function) {
  add_pieces(function);
  add_bins();
  const std::size_t padded = std::max(in_registers, count + 1);
  starts.resize(padded, outside);
  for (auto* all : {&values, &slopes})
    for (std::vector<float>& channel : *all) channel.resize(padded);
  peaks.resize(padded);
  for (std::vector<float>& channel : peak_colors) channel.resize(padded);
}

void FunctionPieces::add_pieces(const TransferFunction& function) {
  const auto outer = [&](double t) { return dvec4(function.color_at(t), function.extinction_at(t)); };
  dvec4 peak(0);  // colour times extinction, extinction: integrals
  const std::vector<UPiece> pieces = pieces_by_value(function);
  origin = choose_origin(pieces);
  const auto add = [&](double start, const dvec4& at, const dvec4& slope) {
    starts.push_back(static_cast<float>(start - origin));
    for (int c = 0; c < 4; ++c) {
      values[static_cast<std::size_t>(c)].push_back(nearest_float(at[c]));
      slopes[static_cast<std::size_t>(c)].push_back(nearest_float(slope[c]));
    }
    peaks.push_back(nearest_float(peak[3]));
    for (int c = 0; c < 3; ++c)
      peak_colors[static_cast<std::size_t>(c)].push_back(peak[3] > 0 ? static_cast<float>(peak[c] / peak[3]) : 0.0F);
    has_peaks = has_peaks || peak[3] > 0;
    peak = dvec4(0);
    ++count;
  };
  add(-static_cast<double>(outside), outer(-1), dvec4(0));
  for (const UPiece& p : pieces) {
    const double width = p.width();
    if (!p.is_resolved_from(origin)) {
      const double k0 = p.at_begin[3], k1 = p.at_end[3];
      for (int c = 0; c < 3; ++c)
        peak[c] += width * (p.at_begin[c] * (k0 / 3 + k1 / 6) + p.at_end[c] * (k0 / 6 + k1 / 3));
      peak[3] += width * (k0 + k1) / 2;
    } else {
      // A ray that crosses the piece gets the whole integral, as wide as single precision makes the piece.
      const double rounded = static_cast<double>(static_cast<float>(p.end - origin)) -
                             static_cast<double>(static_cast<float>(p.begin - origin));
      const dvec4 scale(1, 1, 1, width / rounded);
      add(p.begin, p.at_begin * scale, (p.at_end - p.at_begin) / rounded * scale);
    }
  }
  add(1, outer(2), dvec4(0));
}

// A bin shows something if a piece in it has extinction, or a peak is in it. Rounding may take values to the next bin.
void FunctionPieces::add_bins() {
  constexpr double margin = 1e-6;
  bin_of_origin = static_cast<float>(origin * bins + 1);
  const auto shows = [&](std::size_t i) { return values[3][i] > 0 || slopes[3][i] > 0; };
  std::int32_t piece = 0, visible = 0;
  for (int bin = 0; bin < bins + 2; ++bin) {
    const auto edge = [&](int number, double outwards) {
      return static_cast<float>(static_cast<double>(number) / bins - origin + outwards);
    };
    const float low = bin == 0 ? -outside : edge(bin - 1, -margin), high = bin > bins ? outside : edge(bin, margin);
    while (static_cast<std::size_t>(piece) + 1 < count && starts[static_cast<std::size_t>(piece) + 1] <= low) ++piece;
    first_of_bin.push_back(piece);
    visible_before.push_back(visible);
    bool shown = peaks[static_cast<std::size_t>(piece)] > 0 || shows(static_cast<std::size_t>(piece));
    for (std::size_t i = static_cast<std::size_t>(piece) + 1; i < count && starts[i] <= high; ++i)
      shown = shown || shows(i) || peaks[i] > 0;
    visible += shown ? 1 : 0;
  }
  visible_before.push_back(visible);
}

}  // namespace splatvol::tiles
