#include "builder/sources/repeated_pieces.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <utility>

namespace splatvol {
namespace {

// Two sets of tetrahedra that share most of their members share some of their smallest hashes too.
constexpr std::size_t sampled_tetrahedra = 64;

/// The finaliser of SplitMix64.
std::uint64_t mix(std::uint64_t x) {
  x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9u;
  x = (x ^ (x >> 27)) * 0x94d049bb133111ebu;
  return x ^ (x >> 31);
}

std::uint64_t combine(std::uint64_t hash, std::uint64_t word) { return mix(hash * 0x9e3779b97f4a7c15u + word + 1); }

std::uint64_t hash_points(const std::vector<dvec3>& points) {
  std::uint64_t hash = points.size();
  for (const dvec3& p : points)
    for (int axis = 0; axis < 3; ++axis) hash = combine(hash, std::bit_cast<std::uint64_t>(p[axis]));
  return hash;
}

Box box_of(const std::vector<dvec3>& points) {
  Box box;
  for (const dvec3& p : points)
    if (std::isfinite(p.x + p.y + p.z)) box.include({p, p});
  return box;
}

std::vector<std::uint64_t> sample(const std::vector<std::array<std::uint32_t, 4>>& tetrahedra) {
  std::vector<std::uint64_t> smallest;
  smallest.reserve(2 * sampled_tetrahedra);
  const auto reduce = [&] {
    std::ranges::sort(smallest);
    const auto repeated = std::ranges::unique(smallest);
    smallest.erase(repeated.begin(), repeated.end());
    smallest.resize(std::min(smallest.size(), sampled_tetrahedra));
  };
  std::uint64_t limit = ~std::uint64_t{0};
  for (auto corners : tetrahedra) {
    std::ranges::sort(corners);
    std::uint64_t hash = 0;
    for (const std::uint32_t corner : corners) hash = combine(hash, corner);
    if (hash > limit) continue;
    smallest.push_back(hash);
    if (smallest.size() < 2 * sampled_tetrahedra) continue;
    reduce();
    if (smallest.size() == sampled_tetrahedra) limit = smallest.back();
  }
  reduce();
  return smallest;
}

bool share_a_member(const std::vector<std::uint64_t>& a, const std::vector<std::uint64_t>& b) {
  return std::ranges::any_of(a, [&](std::uint64_t hash) { return std::ranges::binary_search(b, hash); });
}

}  // namespace

RepeatedPieces::Fingerprint RepeatedPieces::fingerprint(std::string file, const Piece& piece) {
  return {std::move(file), piece.points.size(), hash_points(piece.points), box_of(piece.points),
          sample(piece.tetrahedra)};
}

Status RepeatedPieces::add(const std::string& file, const Piece& piece) { return add(fingerprint(file, piece)); }

Status RepeatedPieces::add(Fingerprint print) {
  if (print.points == 0) return {};
  const auto [first, last] = seen_.equal_range(print.positions);
  const auto repeated = std::find_if(first, last, [&](const auto& entry) {
    const Fingerprint& other = entry.second;
    if (other.file == print.file || other.points != print.points) return false;
    if (other.box != print.box) return false;
    return other.tetrahedra.empty() || print.tetrahedra.empty() || share_a_member(other.tetrahedra, print.tetrahedra);
  });
  if (repeated != last)
    return fail(ErrorCode::invalid_argument,
                "{}: has the same {} points as {}, so they are no pieces of one data set; if they are time steps, "
                "give --series",
                print.file, print.points, repeated->second.file);
  const std::uint64_t hash = print.positions;
  seen_.emplace(hash, std::move(print));
  return {};
}

}  // namespace splatvol
