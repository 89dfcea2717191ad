#include "builder/points/piece_faces.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <functional>

#include "builder/mesh/boundary.h"
#include "builder/sorting/morton.h"
#include "format/codec.h"

namespace splatvol {
namespace {

// An outer face of a piece.
struct Face {
  std::array<Corner, 3> corners;  // ascending
  dvec3 area;                     // vector, outwards; 0: the face does not count
};

template <class Record, class Key>
KeyFunction key_function(Key key) {
  return [key](std::span<const std::byte> records, std::span<MortonKey> keys) {
    for (std::size_t i = 0; i < keys.size(); ++i) keys[i] = key(record_at<Record>(records, i));
  };
}

// Equal faces get equal keys. Other faces that get the same key cost a comparison. Values do not count: the order in
// which areas add up must be the same at all steps of a time series.
MortonKey face_key(const Face& face) {
  const std::array<dvec3, 3> positions = {face.corners[0].position, face.corners[1].position, face.corners[2].position};
  const std::uint64_t hash = format::hash_bytes(std::as_bytes(std::span(positions)));
  return {hash >> 1, 0};
}

bool is_outer(const Face& face, std::span<const Face> of_one_key) {
  const auto same = std::ranges::count_if(of_one_key, [&](const Face& f) { return f.corners == face.corners; });
  const auto& [a, b, c] = face.corners;
  return same == 1 && !(a == b) && !(b == c) && face.area != dvec3(0);
}

// Adds a third of each outer face at each of its corners.
Status add_corners(std::span<const Face> of_one_key, ExternalSorter& corners) {
  for (const Face& face : of_one_key) {
    if (!is_outer(face, of_one_key)) continue;
    std::array<CornerArea, 3> thirds;
    for (std::size_t k = 0; k < 3; ++k) thirds[k] = {face.corners[k], face.area / 3.0};
    SPLATVOL_TRY(corners.add(std::as_bytes(std::span(thirds))));
  }
  return {};
}

// Adds the corners of the faces that one piece alone has.
Status add_outer_faces(ExternalSorter& faces, ExternalSorter& corners) {
  std::vector<Face> of_one_key;
  MortonKey key;
  for (;;) {
    SPLATVOL_TRY_ASSIGN(sorted, faces.next());
    if (sorted.keys.empty()) return add_corners(of_one_key, corners);
    for (std::size_t i = 0; i < sorted.keys.size(); ++i) {
      if (!of_one_key.empty() && sorted.keys[i] != key) {
        SPLATVOL_TRY(add_corners(of_one_key, corners));
        of_one_key.clear();
      }
      key = sorted.keys[i];
      of_one_key.push_back(record_at<Face>(sorted.records, i));
    }
  }
}

}  // namespace

std::size_t PieceFaces::least_memory() { return ExternalSorter::least_memory(sizeof(Face)); }

Status PieceFaces::add(const Piece& piece, std::span<const std::size_t> kept, std::span<const std::byte> records) {
  if (!faces_) {
    SPLATVOL_TRY_ASSIGN(
        sorter, ExternalSorter::create({sizeof(Face), key_function<Face>(face_key), memory_, memory_, folder_}));
    faces_.emplace(std::move(sorter));
  }
  std::vector<std::size_t> record_of(piece.points.size());
  for (std::size_t k = 0; k < kept.size(); ++k) record_of[kept[k]] = k;
  std::vector<Face> faces;
  for (const OuterFace& outer : find_outer_faces(piece.points, piece.tetrahedra)) {
    Face face{};
    const auto position = [&](std::size_t c) { return piece.points[outer.corners[c]] + 0.0; };  // not -0
    if (outer.has_side) face.area = glm::cross(position(1) - position(0), position(2) - position(0)) / 2.0;
    const double square = glm::dot(face.area, face.area);
    if (!(square > 0) || !std::isfinite(square)) face.area = dvec3(0);
    for (std::size_t c = 0; c < 3; ++c) {
      const std::byte* record = records.data() + record_of[outer.corners[c]] * layout_.bytes();
      face.corners[c] = {position(c), hash_values(layout_, record)};
    }
    std::ranges::sort(face.corners, std::less<>());
    faces.push_back(face);
  }
  return faces_->add(std::as_bytes(std::span(faces)));
}

Result<std::optional<BoundaryCorners>> PieceFaces::join(const Cube& cube) {
  if (!faces_) return std::nullopt;
  const auto key = [cube](const CornerArea& area) { return morton_key(area.corner.position, cube); };
  SPLATVOL_TRY_ASSIGN(
      corners, ExternalSorter::create({sizeof(CornerArea), key_function<CornerArea>(key), memory_, memory_, folder_}));
  SPLATVOL_TRY(faces_->finish());
  SPLATVOL_TRY(add_outer_faces(*faces_, corners));
  faces_.reset();
  SPLATVOL_TRY(corners.finish());
  return BoundaryCorners(layout_, std::move(corners));
}

}  // namespace splatvol
