#include "tools/refined_source.h"

#include <algorithm>
#include <limits>
#include <numeric>
#include <span>
#include <unordered_map>
#include <utility>

#include "builder/mesh/moments.h"
#include "builder/sorting/morton.h"

namespace splatvol {
namespace {

constexpr std::size_t piece_tetrahedra = 1'500'000;

/// Copies some tetrahedra of a piece, with the points that they use in the order of first use.
Piece part_of(const Piece& whole, std::span<const std::uint32_t> cells) {
  Piece part;
  part.values.resize(whole.values.size());
  std::unordered_map<std::uint32_t, std::uint32_t> numbers;
  for (const std::uint32_t cell : cells) {
    Tetrahedron corners = whole.tetrahedra[cell];
    for (std::uint32_t& point : corners) {
      const auto [found, is_new] = numbers.try_emplace(point, static_cast<std::uint32_t>(part.points.size()));
      if (is_new) {
        part.points.push_back(whole.points[point]);
        for (std::size_t a = 0; a < part.values.size(); ++a) part.values[a].push_back(whole.values[a][point]);
      }
      point = found->second;
    }
    part.tetrahedra.push_back(corners);
  }
  return part;
}

/// Adds the middle of each edge to a piece, once.
class EdgeMiddles {
 public:
  explicit EdgeMiddles(Piece& piece) : piece_(piece) { middles_.reserve(2 * piece.tetrahedra.size()); }

  std::uint32_t operator()(std::uint32_t a, std::uint32_t b) {
    const std::uint64_t edge = std::uint64_t{std::min(a, b)} << 32 | std::max(a, b);
    const auto [found, is_new] = middles_.try_emplace(edge, static_cast<std::uint32_t>(piece_.points.size()));
    if (is_new) {
      // A sum of two numbers does not depend on their order, so pieces agree on their common points.
      piece_.points.push_back((piece_.points[a] + piece_.points[b]) / 2.0);
      for (auto& values : piece_.values) values.push_back((values[a] + values[b]) / 2);
    }
    return found->second;
  }

 private:
  Piece& piece_;
  std::unordered_map<std::uint64_t, std::uint32_t> middles_;
};

/// Splits every tetrahedron into eight, by Bey's rule. Its order of corners mirrors the sixth and the eighth.
void split(Piece& piece) {
  EdgeMiddles middle(piece);
  std::vector<Tetrahedron> parts;
  parts.reserve(8 * piece.tetrahedra.size());
  for (const auto& [a, b, c, d] : piece.tetrahedra) {
    const std::uint32_t ab = middle(a, b), ac = middle(a, c), ad = middle(a, d);
    const std::uint32_t bc = middle(b, c), bd = middle(b, d), cd = middle(c, d);
    for (const Tetrahedron& part : std::initializer_list<Tetrahedron>{{a, ab, ac, ad},
                                                                      {ab, b, bc, bd},
                                                                      {ac, bc, c, cd},
                                                                      {ad, bd, cd, d},
                                                                      {ab, ac, ad, bd},
                                                                      {ab, ac, bc, bd},
                                                                      {ac, ad, bd, cd},
                                                                      {ac, bc, bd, cd}})
      parts.push_back(part);
  }
  piece.tetrahedra = std::move(parts);
}

/// Turns the tetrahedra that `refinements` splits have mirrored.
void turn_mirrored(Piece& piece, int refinements) {
  for (std::size_t i = 0; i < piece.tetrahedra.size(); ++i) {
    bool is_mirrored = false;
    for (int r = 0; r < refinements; ++r) {
      const std::size_t child = i >> static_cast<unsigned>(3 * r) & 7;
      is_mirrored ^= child == 5 || child == 7;
    }
    if (is_mirrored) std::swap(piece.tetrahedra[i][2], piece.tetrahedra[i][3]);
  }
}

/// Lists tetrahedra along a Morton curve through their corners' means, so that successive ones are close together.
std::vector<std::uint32_t> ordered_cells(const Piece& piece) {
  Box box;
  for (const Tetrahedron& corners : piece.tetrahedra)
    for (const std::uint32_t point : corners) box.include({piece.points[point], piece.points[point]});
  const dvec3 size = box.high - box.low;
  const Cube cube{box.low, std::max({size.x, size.y, size.z, std::numeric_limits<double>::min()})};
  std::vector<MortonKey> keys;
  for (const auto& [a, b, c, d] : piece.tetrahedra)
    keys.push_back(morton_key((piece.points[a] + piece.points[b] + piece.points[c] + piece.points[d]) / 4.0, cube));
  std::vector<std::uint32_t> cells(keys.size());
  std::iota(cells.begin(), cells.end(), 0u);
  std::ranges::stable_sort(cells, {}, [&](std::uint32_t cell) { return keys[cell]; });
  return cells;
}

class RefinedSource final : public Source {
 public:
  RefinedSource(std::unique_ptr<Source> source, int refinements, std::string name)
      : source_(std::move(source)),
        refinements_(refinements),
        name_(std::move(name)),
        part_size_(std::max<std::size_t>(1, piece_tetrahedra >> static_cast<unsigned>(3 * refinements))) {}

  const std::vector<std::string>& attributes() const override { return source_->attributes(); }
  std::vector<std::string> units() const override { return source_->units(); }
  std::vector<int> components() const override { return source_->components(); }
  std::size_t piece_count() const override { return made_ + parts_left() + (source_->piece_count() - read_); }

  Result<std::unique_ptr<Piece>> next() override {
    if (parts_left() == 0) {
      SPLATVOL_TRY_ASSIGN(piece, source_->next());
      if (!piece) return nullptr;
      if (piece->tetrahedra.empty()) return fail(ErrorCode::invalid_data, "{}: no cells with a volume", name_);
      whole_ = std::move(piece);
      cells_ = ordered_cells(*whole_);
      begin_ = 0;
      ++read_;
    }
    const std::size_t count = std::min(part_size_, cells_.size() - begin_);
    auto part = std::make_unique<Piece>(part_of(*whole_, std::span(cells_).subspan(begin_, count)));
    for (int r = 0; r < refinements_; ++r) split(*part);
    turn_mirrored(*part, refinements_);
    part->census.cells["tetrahedron"] = part->census.tetrahedra = part->tetrahedra.size();
    begin_ += count;
    ++made_;
    return part;
  }

 private:
  [[nodiscard]] std::size_t parts_left() const { return (cells_.size() - begin_ + part_size_ - 1) / part_size_; }

  std::unique_ptr<Source> source_;
  int refinements_;
  std::string name_;
  std::size_t part_size_;  // tetrahedra of the source that make a piece
  std::unique_ptr<Piece> whole_;
  std::vector<std::uint32_t> cells_;  // of whole_, in the order in which they are refined
  std::size_t begin_ = 0;             // of the next part, in cells_
  std::size_t read_ = 0;              // pieces of the source so far
  std::size_t made_ = 0;              // pieces so far
};

}  // namespace

std::unique_ptr<Source> refine(std::unique_ptr<Source> source, int refinements, const std::string& name) {
  return std::make_unique<RefinedSource>(std::move(source), refinements, name);
}

}  // namespace splatvol
