#include "renderer/transfer_table.h"

#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

namespace splatvol {

namespace {

using glm::dvec4;

/// A stretch of t = (value - lo) / (hi - lo) without control points inside: all is linear there.
struct Piece {
  double begin, end;
  dvec4 at_begin, at_end;  // colour, extinction
};

/// The piecewise-linear function through `points` just before t: where two points share a t, the earlier one holds.
template <class Point, class Value>
Value before(const std::vector<Point>& points, Value Point::*value, double t) {
  const auto next = std::ranges::lower_bound(points, t, {}, &Point::t);
  if (next == points.begin()) return points.front().*value;
  const Point& left = *(next - 1);
  if (next == points.end()) return left.*value;
  const double share = (t - left.t) / (next->t - left.t);
  return left.*value * (1 - share) + (*next).*value * share;
}

/// The pieces of [0, 1] in order. Control points closer together than 1e-9 are a jump.
std::vector<Piece> pieces(TransferFunction function) {
  using Color = TransferFunction::Color;
  using Density = TransferFunction::Density;
  function.lo = 0;
  function.hi = 1;
  std::vector<double> bends{0, 1};
  for (const Color& point : function.colors) bends.push_back(std::clamp(point.t, 0.0, 1.0));
  for (const Density& point : function.densities) bends.push_back(std::clamp(point.t, 0.0, 1.0));
  std::ranges::sort(bends);

  std::vector<Piece> result;
  double begin = 0;
  for (std::size_t i = 1; i < bends.size(); ++i) {
    if (bends[i] - begin < 1e-9) continue;
    const double after = bends[i - 1];
    result.push_back({begin, bends[i], dvec4(function.color(after), function.extinction(after)),
                      dvec4(before(function.colors, &Color::rgb, bends[i]),
                            before(function.densities, &Density::extinction, bends[i]))});
    begin = bends[i];
  }
  return result;
}

/// Colour times extinction, and extinction, as a polynomial of t.
struct Polynomial {
  dvec4 constant, linear, square;
};

class Averager {
 public:
  explicit Averager(const TransferFunction& function) : pieces_(pieces(function)) {
    double largest = 0;
    for (const Piece& piece : pieces_) largest = std::max({largest, piece.at_begin.a, piece.at_end.a});
    // Where nothing is opaque, the colour is that of something a billionth as opaque as the most opaque.
    least_ = largest > 0 ? 1e-9 * largest : 1;

    const Piece& first = pieces_.front();
    const Piece& last = pieces_.back();
    polynomials_.push_back(product({0, 1, first.at_begin, first.at_begin}));
    for (const Piece& piece : pieces_) polynomials_.push_back(product(piece));
    polynomials_.push_back(product({0, 1, last.at_end, last.at_end}));
  }

  /// Over values of this mean and spread, in t.
  [[nodiscard]] vec4 operator()(double mean, double spread) const {
    dvec4 sum(0);
    Edge below{};
    for (std::size_t i = 0; i < polynomials_.size(); ++i) {
      const Edge above = i < pieces_.size() + 1 ? edge(pieces_, i, mean, spread) : Edge{1, 0, 0};
      const double whole = above.below - below.below;
      if (whole > 0) {
        // Moments about the mean of the part of the distribution between the edges.
        const double first = spread * (below.density - above.density);
        const double second = spread * spread * (whole + below.slope - above.slope);
        const Polynomial& p = polynomials_[i];
        sum += whole * (p.constant + mean * (p.linear + mean * p.square)) + first * (p.linear + 2 * mean * p.square) +
               second * p.square;
      }
      below = above;
    }
    return finish(sum);
  }

  [[nodiscard]] vec4 operator()(double t) const {
    std::size_t i = 0;
    while (i < pieces_.size() && pieces_[i].begin <= t) ++i;
    if (i == pieces_.size() && t > pieces_.back().end) ++i;
    const Polynomial& p = polynomials_[i];
    return finish(p.constant + t * (p.linear + t * p.square));
  }

 private:
  /// Of the normal distribution at z: what lies below, its density, and z times this.
  struct Edge {
    double below, density, slope;
  };

  static Edge edge(const std::vector<Piece>& pieces, std::size_t i, double mean, double spread) {
    const double z = ((i < pieces.size() ? pieces[i].begin : pieces.back().end) - mean) / spread;
    if (z < -9) return {0, 0, 0};
    if (z > 9) return {1, 0, 0};
    const double density = std::exp(-0.5 * z * z) * (std::numbers::inv_sqrtpi / std::numbers::sqrt2);
    return {0.5 * std::erfc(-z / std::numbers::sqrt2), density, z * density};
  }

  [[nodiscard]] Polynomial product(const Piece& piece) const {
    const dvec4 slope = (piece.at_end - piece.at_begin) / (piece.end - piece.begin);
    const dvec4 start = piece.at_begin - slope * piece.begin;
    const dvec4 factor(start.a + least_, start.a + least_, start.a + least_, 1);
    const dvec4 factor_slope(slope.a, slope.a, slope.a, 0);
    return {start * factor, start * factor_slope + slope * factor, slope * factor_slope};
  }

  [[nodiscard]] vec4 finish(dvec4 sum) const {
    sum = glm::max(sum, 0.0);
    return vec4(dvec4(glm::dvec3(sum) / (sum.a + least_), sum.a));
  }

  std::vector<Piece> pieces_;
  std::vector<Polynomial> polynomials_;  // before all pieces, of each, after all
  double least_ = 0;                     // extinction
};

}  // namespace

double TransferTable::spread(std::size_t row) const {
  return row == 0 ? 0 : (std::pow(513.0, static_cast<double>(row) / static_cast<double>(rows - 1)) - 1) / 64;
}

double TransferTable::mean(std::size_t row, std::size_t column) const {
  return 0.5 + (1 + 8 * spread(row)) * (static_cast<double>(column) / static_cast<double>(columns - 1) - 0.5);
}

TransferTable make_transfer_table(const TransferFunction& function, std::size_t columns, std::size_t rows) {
  const Averager average(function);
  TransferTable table{columns, rows, std::vector<vec4>(columns * rows)};
  tbb::parallel_for(std::size_t{0}, rows, [&](std::size_t row) {
    const double spread = table.spread(row);
    for (std::size_t column = 0; column < columns; ++column) {
      const double mean = table.mean(row, column);
      table.entries[row * columns + column] = row == 0 ? average(mean) : average(mean, spread);
    }
  });
  return table;
}

std::vector<std::vector<float>> make_peak_levels(const TransferFunction& function, std::size_t steps) {
  std::vector<std::vector<float>> levels{std::vector<float>(steps)};
  const auto count = static_cast<double>(steps);
  for (const Piece& piece : pieces(function)) {
    const double slope = (piece.at_end.a - piece.at_begin.a) / (piece.end - piece.begin);
    const auto at = [&](double t) { return static_cast<float>(piece.at_begin.a + slope * (t - piece.begin)); };
    for (auto step = static_cast<std::size_t>(piece.begin * count); step < steps && step < piece.end * count; ++step) {
      float& peak = levels[0][step];
      peak = std::max({peak, at(std::max(piece.begin, static_cast<double>(step) / count)),
                       at(std::min(piece.end, static_cast<double>(step + 1) / count))});
    }
  }
  while (levels.back().size() > 1) {
    const std::vector<float>& finer = levels.back();
    std::vector<float> level(finer.size() / 2);
    for (std::size_t i = 0; i < level.size(); ++i) level[i] = std::max(finer[2 * i], finer[2 * i + 1]);
    levels.push_back(std::move(level));
  }
  return levels;
}

}  // namespace splatvol
