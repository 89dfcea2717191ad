#include "renderer/transfer_table.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <limits>
#include <mutex>
#include <numbers>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "base/parallel.h"

namespace splatvol {

namespace {

using glm::dvec4;

/// Colour times extinction, and extinction, as a polynomial of t.
struct Polynomial {
  dvec4 constant, linear, square;
};

// One number for each of several means.
constexpr std::size_t lanes = 4;
using Lanes [[gnu::vector_size(lanes * sizeof(double))]] = double;

/// The normal distribution between -9 and 9: nodes, and a Taylor series from the nearest.
class NormalDistribution {
 public:
  static constexpr double end = 9;

  struct At {
    Lanes below, density;  // the integral up to z, and its derivative
  };

  /// Requires -9 <= z <= 9; 0 or 1 at the ends. Exact to 1e-15.
  [[nodiscard]] At operator()(const Lanes& z) const {
    Lanes below_node, density_node, z_node;
    for (std::size_t l = 0; l < lanes; ++l) {
      const auto node = static_cast<std::size_t>((z[l] + (end + half_a_node)) * nodes_per_unit);
      below_node[l] = below_[node];
      density_node[l] = density_[node];
      z_node[l] = static_cast<double>(node) * (1 / nodes_per_unit) - end;
    }
    // density(z + d) = density(z) (g_0 + g_1 + ...), with g_0 = 1 and n g_n = -z d g_(n-1) - d^2 g_(n-2).
    const Lanes d = z - z_node;
    Lanes before{}, term = Lanes{} + 1, density = term, below = term;
    for (int n = 1; n <= 8; ++n) {
      const Lanes next = -d * (z_node * term + d * before) * (1.0 / n);
      before = term;
      term = next;
      density += term;
      below += term * (1.0 / (n + 1));
    }
    return {below_node + density_node * d * below, density_node * density};
  }

  static const NormalDistribution& get() {
    static const NormalDistribution distribution;
    return distribution;
  }

 private:
  static constexpr double nodes_per_unit = 64, half_a_node = 0.5 / nodes_per_unit;
  static constexpr std::size_t nodes = 2 * static_cast<std::size_t>(end * nodes_per_unit) + 1;

  NormalDistribution() {
    for (std::size_t k = 1; k + 1 < nodes; ++k) {
      const double z = static_cast<double>(k) / nodes_per_unit - end;
      below_[k] = 0.5 * std::erfc(-z / std::numbers::sqrt2);
      density_[k] = std::exp(-0.5 * z * z) * (std::numbers::inv_sqrtpi / std::numbers::sqrt2);
    }
    below_[nodes - 1] = 1;
  }

  std::array<double, nodes> below_{}, density_{};
};

struct Range {
  std::size_t begin, end;
};

/// The normal distributions round several means, at an edge of a piece. A vector for each number, so that compilers
/// make vectors of the loops.
struct Edges {
  std::vector<double> below, density, slope;  // the integral below the edge, the density there, and z times the density

  Edges(std::size_t means, double all_below) : below(means, all_below), density(means), slope(means) {}

  /// `range`: of the means that have the edge in their distribution.
  void set(double edge, double spread, std::span<const double> means, Range range) {
    std::fill(below.begin(), below.begin() + static_cast<std::ptrdiff_t>(range.begin), 1.0);
    std::fill(below.begin() + static_cast<std::ptrdiff_t>(range.end), below.end(), 0.0);
    std::ranges::fill(density, 0.0);
    std::ranges::fill(slope, 0.0);
    const NormalDistribution& normal = NormalDistribution::get();
    for (std::size_t k = range.begin; k < range.end; k += lanes) {
      const std::size_t count = std::min(lanes, range.end - k);
      Lanes z{};
      for (std::size_t l = 0; l < count; ++l)
        z[l] = std::clamp((edge - means[k + l]) / spread, -NormalDistribution::end, NormalDistribution::end);
      const auto [at_below, at_density] = normal(z);
      for (std::size_t l = 0; l < count; ++l) {
        below[k + l] = at_below[l];
        density[k + l] = at_density[l];
        slope[k + l] = z[l] * at_density[l];
      }
    }
  }
};

/// Averages round several means, as sums over pieces.
struct Sums {
  std::vector<double> means;
  std::array<std::vector<double>, 4> channels;

  explicit Sums(std::size_t count) : means(count) { channels.fill(means); }

  /// Adds the part of a piece, for the means of a range.
  void add(const Polynomial& p, double spread, const Edges& below, const Edges& above, Range range) {
    for (int channel = 0; channel < 4; ++channel) {
      const double constant = p.constant[channel], linear = p.linear[channel], square = p.square[channel];
      double* __restrict sums = channels[static_cast<std::size_t>(channel)].data();
      for (std::size_t k = range.begin; k < range.end; ++k) {
        // Moments about the mean of the part of the distribution between the edges.
        const double whole = above.below[k] - below.below[k], mean = means[k];
        const double first = spread * (below.density[k] - above.density[k]);
        const double second = spread * spread * (whole + below.slope[k] - above.slope[k]);
        sums[k] += whole * (constant + mean * (linear + mean * square)) + first * (linear + 2 * mean * square) +
                   second * square;
      }
    }
  }

  /// The same for a piece that is narrow beside the distributions: its `integral` counts with their density there. The
  /// sums above would be differences of large numbers.
  void add_narrow(const dvec4& integral, double spread, const Edges& below, Range range) {
    for (int channel = 0; channel < 4; ++channel)
      for (std::size_t k = range.begin; k < range.end; ++k)
        channels[static_cast<std::size_t>(channel)][k] += integral[channel] * below.density[k] / spread;
  }
};

class Averager {
 public:
  explicit Averager(const TransferFunction& function)
      : pieces_(linear_pieces(function)), before_(end_of(function, -1)), behind_(end_of(function, 2)) {
    double largest = std::max(before_.a, behind_.a);
    for (const LinearPiece& piece : pieces_) largest = std::max({largest, piece.at_begin.a, piece.at_end.a});
    brightest_ = glm::max(glm::dvec3(before_), glm::dvec3(behind_));
    for (const LinearPiece& piece : pieces_)
      brightest_ = glm::max(brightest_, glm::max(glm::dvec3(piece.at_begin), glm::dvec3(piece.at_end)));

    // Added to the extinction where colours are weighted, so that clear values have a colour too.
    least_ = largest > 0 ? 1e-9 * largest : 1;

    polynomials_.push_back(product({0, 1, before_, before_}));
    for (const LinearPiece& piece : pieces_) {
      polynomials_.push_back(product(piece));
      integrals_.push_back(integral(piece));
    }
    polynomials_.push_back(product({0, 1, behind_, behind_}));
  }

  /// Averages over values of this spread, in t, round means in an arithmetic progression.
  void operator()(double first_mean, double mean_step, double spread, std::span<vec4> out) const {
    Sums sums(out.size());
    for (std::size_t k = 0; k < out.size(); ++k) sums.means[k] = first_mean + mean_step * static_cast<double>(k);
    // The means that have a part of their distributions between two values.
    const auto range_between = [&](double low, double high) {
      const double reach = NormalDistribution::end * spread;
      const auto number_of = [&](double mean) {
        return static_cast<std::size_t>(
            std::clamp((mean - first_mean) / mean_step, 0.0, static_cast<double>(out.size() - 1)));
      };
      return Range{number_of(low - reach), number_of(high + reach) + 1};
    };
    constexpr double far = std::numeric_limits<double>::infinity();
    Edges below(out.size(), 0), above(out.size(), 1);
    double low = -far;
    for (std::size_t i = 0; i < polynomials_.size(); ++i) {
      const double high = i < pieces_.size() ? pieces_[i].begin : i == pieces_.size() ? pieces_.back().end : far;
      if (high < far)
        above.set(high, spread, sums.means, range_between(high, high));
      else
        above = Edges(out.size(), 1);
      constexpr double narrow = 1e-4;  // beside the spread
      if (i > 0 && i <= pieces_.size() && high - low < narrow * spread)
        sums.add_narrow(integrals_[i - 1], spread, below, range_between(low, high));
      else
        sums.add(polynomials_[i], spread, below, above, range_between(low, high));
      low = high;
      std::swap(below, above);
    }
    for (std::size_t k = 0; k < out.size(); ++k)
      out[k] = finish({sums.channels[0][k], sums.channels[1][k], sums.channels[2][k], sums.channels[3][k]});
  }

  [[nodiscard]] vec4 operator()(double t) const {
    std::size_t i = 0;
    while (i < pieces_.size() && pieces_[i].begin <= t) ++i;
    if (i == 0) return finish(weighted(before_));
    if (t >= pieces_.back().end) return finish(weighted(behind_));
    const LinearPiece& piece = pieces_[i - 1];
    return finish(weighted(glm::mix(piece.at_begin, piece.at_end, (t - piece.begin) / (piece.end - piece.begin))));
  }

 private:
  static dvec4 end_of(const TransferFunction& function, double t) {
    return {function.color_at(t), function.extinction_at(t)};
  }

  [[nodiscard]] Polynomial product(const LinearPiece& piece) const {
    const dvec4 slope = (piece.at_end - piece.at_begin) / (piece.end - piece.begin);
    const dvec4 start = piece.at_begin - slope * piece.begin;
    const dvec4 factor(start.a + least_, start.a + least_, start.a + least_, 1);
    const dvec4 factor_slope(slope.a, slope.a, slope.a, 0);
    return {start * factor, start * factor_slope + slope * factor, slope * factor_slope};
  }

  // Colour times extinction, and extinction.
  [[nodiscard]] dvec4 weighted(const dvec4& at) const { return {glm::dvec3(at) * (at.a + least_), at.a}; }

  // Simpson's rule is exact for the products of linear functions.
  [[nodiscard]] dvec4 integral(const LinearPiece& piece) const {
    const dvec4 middle = weighted((piece.at_begin + piece.at_end) / 2.0);
    return (piece.end - piece.begin) / 6 * (weighted(piece.at_begin) + 4.0 * middle + weighted(piece.at_end));
  }

  [[nodiscard]] vec4 finish(dvec4 sum) const {
    // Where nearly all is clear, sums are differences of large numbers.
    sum = glm::max(sum, 0.0);
    return vec4(dvec4(glm::min(glm::dvec3(sum) / (sum.a + least_), brightest_), sum.a));
  }

  std::vector<LinearPiece> pieces_;
  dvec4 before_, behind_;                // outside of [0, 1]
  std::vector<Polynomial> polynomials_;  // one before the pieces, one for each, one after them
  std::vector<dvec4> integrals_;         // one for each
  double least_ = 0;                     // extinction: a billionth of the largest
  glm::dvec3 brightest_{0};              // the largest of each channel
};

}  // namespace

double TransferTable::spread(std::size_t row) const {
  return row == 0 ? 0 : (std::pow(513.0, static_cast<double>(row) / static_cast<double>(rows - 1)) - 1) / 64;
}

double TransferTable::mean(std::size_t row, std::size_t column) const {
  const double first = margin, inner = static_cast<double>(columns - 1 - 2 * margin);
  return 0.5 + (1 + 8 * spread(row)) * ((static_cast<double>(column) - first) / inner - 0.5);
}

namespace {

TransferTable average(const TransferFunction& function, std::size_t columns, std::size_t rows) {
  const Averager average(function);
  TransferTable table{columns, rows, std::vector<vec4>(columns * rows)};
  for (std::size_t column = 0; column < columns; ++column) table.entries[column] = average(table.mean(0, column));
  parallel_for(std::size_t{1}, rows, [&](std::size_t row) {
    const double first = table.mean(row, 0);
    const double step = (table.mean(row, columns - 1) - first) / static_cast<double>(columns - 1);
    average(first, step, table.spread(row), std::span(table.entries).subspan(row * columns, columns));
  });
  return table;
}

// The tables that were asked for last.
class RecentTables {
 public:
  TransferTable get(const TransferFunction& function, std::size_t columns, std::size_t rows) {
    if (auto table = find(function, columns, rows)) return *std::move(table);
    TransferTable table = average(function, columns, rows);  // without the lock: other tasks may run meanwhile
    const std::scoped_lock lock(mutex_);
    if (entries_.size() == most) entries_.pop_back();
    entries_.insert(entries_.begin(), {function.colors, function.densities, table});
    return table;
  }

 private:
  static constexpr std::size_t most = 4;
  struct Entry {
    std::vector<TransferFunction::Color> colors;
    std::vector<TransferFunction::Density> densities;
    TransferTable table;
  };

  std::optional<TransferTable> find(const TransferFunction& function, std::size_t columns, std::size_t rows) {
    const std::scoped_lock lock(mutex_);
    const auto found = std::ranges::find_if(entries_, [&](const Entry& entry) {
      return entry.table.columns == columns && entry.table.rows == rows && entry.colors == function.colors &&
             entry.densities == function.densities;
    });
    if (found == entries_.end()) return std::nullopt;
    std::rotate(entries_.begin(), found, std::next(found));
    return entries_.front().table;
  }

  std::mutex mutex_;
  std::vector<Entry> entries_;  // the last one first
};

}  // namespace

TransferTable make_transfer_table(const TransferFunction& function, std::size_t columns, std::size_t rows) {
  static RecentTables tables;
  return tables.get(function, columns, rows);
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
  levels[0].front() = std::max(levels[0].front(), static_cast<float>(function.extinction_at(-1)));
  levels[0].back() = std::max(levels[0].back(), static_cast<float>(function.extinction_at(2)));
  while (levels.back().size() > 1) {
    const std::vector<float>& finer = levels.back();
    std::vector<float> level(finer.size() / 2);
    for (std::size_t i = 0; i < level.size(); ++i) level[i] = std::max(finer[2 * i], finer[2 * i + 1]);
    levels.push_back(std::move(level));
  }
  return levels;
}

}  // namespace splatvol
