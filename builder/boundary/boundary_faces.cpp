#include "builder/boundary/boundary_faces.h"

#include <algorithm>
#include <span>
#include <tuple>

#include "builder/mesh/boundary.h"
#include "builder/mesh/usable_numbers.h"
#include "format/codec.h"

namespace splatvol {
namespace {

std::tuple<double, double, double> coordinates(const dvec3& p) { return {p.x, p.y, p.z}; }

}  // namespace

// A triangle on its way through the sort.
struct BoundaryFaces::Face {
  std::array<dvec3, 3> corners;  // ascending
  std::uint32_t patch;
  std::uint8_t is_outer;   // of one tetrahedron of its piece
  std::uint8_t has_side;   // and it is known where outside is
  std::uint8_t is_turned;  // the given order of the corners is an odd permutation of this one
  std::uint8_t zero;

  [[nodiscard]] static Face of(std::array<dvec3, 3> corners, std::uint32_t patch, bool is_outer, bool has_side) {
    Face face{{}, patch, is_outer, has_side, 0, 0};
    for (dvec3& corner : corners) corner += 0.0;  // not -0
    const auto order = [&](std::size_t a, std::size_t b) {
      if (coordinates(corners[b]) < coordinates(corners[a])) std::swap(corners[a], corners[b]), face.is_turned ^= 1;
    };
    order(0, 1), order(1, 2), order(0, 1);
    face.corners = corners;
    return face;
  }
  [[nodiscard]] bool is_degenerate() const { return corners[0] == corners[1] || corners[1] == corners[2]; }
};

std::size_t BoundaryFaces::least_memory() { return ExternalSorter::least_memory(sizeof(Face)); }

Result<BoundaryFaces> BoundaryFaces::create(std::size_t memory, const std::string& folder) {
  const auto key = [](std::span<const std::byte> records, std::span<MortonKey> keys) {
    for (std::size_t i = 0; i < keys.size(); ++i)
      keys[i] = {format::hash_bytes(records.subspan(i * sizeof(Face), sizeof(Face::corners))) >> 1, 0};
  };
  SPLATVOL_TRY_ASSIGN(faces, ExternalSorter::create({sizeof(Face), key, memory, memory, folder}));
  return BoundaryFaces(std::move(faces));
}

Status BoundaryFaces::add(const Piece& piece) {
  if (piece.cells)
    SPLATVOL_TRY(add_outer(piece.cells->corners, piece.cells->tetrahedra));
  else
    SPLATVOL_TRY(add_outer(piece.points, piece.tetrahedra));
  for (const Patch& patch : piece.patches) SPLATVOL_TRY(add_patch(patch));
  return {};
}

Status BoundaryFaces::add_outer(const std::vector<dvec3>& points,
                                const std::vector<std::array<std::uint32_t, 4>>& tetrahedra) {
  std::vector<Face> faces;
  for (const OuterFace& outer : find_outer_faces(points, tetrahedra)) {
    std::array<dvec3, 3> corners;
    for (std::size_t k = 0; k < 3; ++k) corners[k] = points[outer.corners[k]];
    faces.push_back(Face::of(corners, 0, true, outer.has_side));
    for (const dvec3& corner : corners) box_.include(corner);
  }
  counts_[0] += faces.size();
  return faces_.add(std::as_bytes(std::span(faces)));
}

Status BoundaryFaces::check_any() const {
  if (std::ranges::any_of(counts_, [](std::uint64_t count) { return count > 0; })) return {};
  return fail(ErrorCode::invalid_data,
              "the input has no cells with a volume, and so no boundary: leave the boundary out");
}

std::uint32_t BoundaryFaces::number_of(const std::string& name) {
  const auto [number, is_new] = numbers_.try_emplace(name, static_cast<std::uint32_t>(names_.size()));
  if (is_new) {
    names_.push_back(name);
    counts_.push_back(0);
  }
  return number->second;
}

Status BoundaryFaces::add_patch(const Patch& patch) {
  const std::uint32_t number = number_of(patch.name);
  input_names_rest_ = input_names_rest_ || number == 0;
  std::vector<Face> faces;
  for (const auto& triangle : patch.mesh.triangles) {
    std::array<dvec3, 3> corners;
    for (std::size_t k = 0; k < 3; ++k) corners[k] = patch.mesh.points[triangle[k]];
    if (std::ranges::all_of(corners, is_usable_position)) faces.push_back(Face::of(corners, number, false, false));
  }
  counts_[number] += faces.size();
  return faces_.add(std::as_bytes(std::span(faces)));
}

// Returns the triangle that bounds the mesh where some faces coincide; nothing if they lie inside.
std::optional<BoundaryTriangle> BoundaryFaces::choose(std::vector<Face>& same) const {
  if (same.front().is_degenerate()) return std::nullopt;
  const auto outer = std::ranges::find_if(same, [](const Face& face) { return face.is_outer != 0; });
  const bool is_outer = std::ranges::count_if(same, [](const Face& face) { return face.is_outer != 0; }) == 1;
  const auto rank = [&](const Face& face) { return std::tuple(face.is_outer, counts_[face.patch], face.patch); };
  const Face& best = *std::ranges::min_element(same, {}, rank);
  if (best.is_outer != 0 && !is_outer) return std::nullopt;
  // A damaged point of a patch belongs to no cell that is kept.
  const auto is_far = [&](const dvec3& corner) { return squared_distance(box_, corner) > 0; };
  if (best.is_outer == 0 && !is_outer && std::ranges::any_of(best.corners, is_far)) return std::nullopt;
  const Face& shape = is_outer ? *outer : best;
  BoundaryTriangle triangle{shape.corners, best.patch, is_outer && outer->has_side != 0};
  if (shape.is_turned != 0) std::swap(triangle.corners[1], triangle.corners[2]);
  return triangle;
}

Status BoundaryFaces::visit(const std::function<Status(const BoundaryTriangle&)>& visit) {
  SPLATVOL_TRY(faces_.finish());
  std::vector<Face> of_one_key, same;
  const auto visit_key = [&]() -> Status {
    while (!of_one_key.empty()) {
      same.clear();
      const auto is_same = [&](const Face& face) { return face.corners == of_one_key.front().corners; };
      std::ranges::copy_if(of_one_key, std::back_inserter(same), is_same);
      const std::array<dvec3, 3> corners = of_one_key.front().corners;
      std::erase_if(of_one_key, [&](const Face& face) { return face.corners == corners; });
      if (const auto triangle = choose(same)) SPLATVOL_TRY(visit(*triangle));
    }
    return {};
  };
  MortonKey key;
  for (;;) {
    SPLATVOL_TRY_ASSIGN(sorted, faces_.next());
    if (sorted.keys.empty()) return visit_key();
    for (std::size_t i = 0; i < sorted.keys.size(); ++i) {
      if (!of_one_key.empty() && sorted.keys[i] != key) SPLATVOL_TRY(visit_key());
      key = sorted.keys[i];
      of_one_key.push_back(format::read_record<Face>(sorted.records, i * sizeof(Face)));
    }
  }
}

}  // namespace splatvol
