#include "renderer/transfer_table.h"

#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

namespace splatvol {

namespace {

using glm::dvec4;

/// Colour times extinction, and extinction, as a polynomial of t.
struct Polynomial {
  dvec4 constant, linear, square;
};

class Averager {
 public:
  explicit Averager(const TransferFunction& function) : pieces_(linear_pieces(function)) {
    double largest = 0;
    for (const LinearPiece& piece : pieces_) largest = std::max({largest, piece.at_begin.a, piece.at_end.a});
    // Added to the extinction where colours are weighted, so that clear values have a colour too.
    least_ = largest > 0 ? 1e-9 * largest : 1;

    const LinearPiece& first = pieces_.front();
    const LinearPiece& last = pieces_.back();
    polynomials_.push_back(product({0, 1, first.at_begin, first.at_begin}));
    for (const LinearPiece& piece : pieces_) polynomials_.push_back(product(piece));
    polynomials_.push_back(product({0, 1, last.at_end, last.at_end}));
  }

  /// Returns the average over values of this mean and spread, in t.
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
  /// The normal distribution at z: its integral below z, its density, and z times the density.
  struct Edge {
    double below, density, slope;
  };

  static Edge edge(const std::vector<LinearPiece>& pieces, std::size_t i, double mean, double spread) {
    const double z = ((i < pieces.size() ? pieces[i].begin : pieces.back().end) - mean) / spread;
    if (z < -9) return {0, 0, 0};
    if (z > 9) return {1, 0, 0};
    const double density = std::exp(-0.5 * z * z) * (std::numbers::inv_sqrtpi / std::numbers::sqrt2);
    return {0.5 * std::erfc(-z / std::numbers::sqrt2), density, z * density};
  }

  [[nodiscard]] Polynomial product(const LinearPiece& piece) const {
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

  std::vector<LinearPiece> pieces_;
  std::vector<Polynomial> polynomials_;  // one before the pieces, one for each, one after them
  double least_ = 0;                     // extinction: a billionth of the largest
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

std::vector<std::vector<float>> make_peak_levels(const TransferFunction& function, std::size_t entries) {
  std::vector<std::vector<float>> levels{std::vector<float>(entries)};
  const auto count = static_cast<double>(entries);
  for (const LinearPiece& piece : linear_pieces(function)) {
    const double slope = (piece.at_end.a - piece.at_begin.a) / (piece.end - piece.begin);
    const auto at = [&](double t) { return static_cast<float>(piece.at_begin.a + slope * (t - piece.begin)); };
    for (auto entry = static_cast<std::size_t>(piece.begin * count); entry < entries && entry < piece.end * count;
         ++entry) {
      float& peak = levels[0][entry];
      peak = std::max({peak, at(std::max(piece.begin, static_cast<double>(entry) / count)),
                       at(std::min(piece.end, static_cast<double>(entry + 1) / count))});
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
