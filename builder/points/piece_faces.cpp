#include "builder/points/piece_faces.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

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
  Corner point;                   // of its cell, if points stand for cells
  BoundaryPlane plane;            // the face, as that point has it
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

// Adds a third of each outer face at each of its corners, or all of it at the point of its cell.
using VisitCorners = std::function<Status(std::span<const std::byte>)>;
Status add_corners(std::span<const Face> of_one_key, bool of_cells, const VisitCorners& visit) {
  for (const Face& face : of_one_key) {
    if (!is_outer(face, of_one_key)) continue;
    std::array<CornerArea, 3> thirds;
    const std::uint64_t key = face_key(face).high;
    for (std::size_t k = 0; k < 3; ++k) thirds[k] = {face.corners[k], {face.area / 3.0, 0}, key};
    const CornerArea whole{face.point, face.plane, key};
    SPLATVOL_TRY(visit(of_cells ? std::as_bytes(std::span(&whole, 1)) : std::as_bytes(std::span(thirds))));
  }
  return {};
}

// Sets the area of a face, and sorts its corners. `positions`: of the corners, counterclockwise from outside.
void finish_face(const OuterFace& outer, const std::array<dvec3, 3>& positions, Face& face) {
  if (outer.has_side) face.area = glm::cross(positions[1] - positions[0], positions[2] - positions[0]) / 2.0;
  const double square = glm::dot(face.area, face.area);
  if (!(square > 0) || !std::isfinite(square)) face.area = dvec3(0);
  std::ranges::sort(face.corners, std::less<>());
}

}  // namespace

std::size_t PieceFaces::least_memory() { return ExternalSorter::least_memory(sizeof(Face)); }

std::size_t PieceFaces::face_bytes() { return sizeof(Face); }

Result<ExternalSorter> PieceFaces::sort_of_faces() const {
  return ExternalSorter::create({sizeof(Face), key_function<Face>(face_key), memory_, memory_, folder_});
}

Result<ExternalSorter> PieceFaces::sort_of_corners(const Cube& cube) const {
  const auto key = [cube](const CornerArea& area) { return morton_key(area.corner.position, cube); };
  return ExternalSorter::create({sizeof(CornerArea), key_function<CornerArea>(key), memory_, memory_, folder_});
}

Status PieceFaces::start() {
  if (faces_) return {};
  SPLATVOL_TRY_ASSIGN(sorter, sort_of_faces());
  faces_.emplace(std::move(sorter));
  return {};
}

// Adds make(face) of each outer face.
template <class MakeFace>
Status PieceFaces::add_faces(std::span<const OuterFace> outer, const MakeFace& make) {
  constexpr std::size_t at_once = 4096;
  SPLATVOL_TRY(start());
  std::vector<Face> faces;
  for (std::size_t first = 0; first < outer.size(); first += at_once) {
    faces.resize(std::min(at_once, outer.size() - first));
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, faces.size(), 64),
                      [&](const tbb::blocked_range<std::size_t>& range) {
                        for (std::size_t i = range.begin(); i < range.end(); ++i) faces[i] = make(outer[first + i]);
                      });
    SPLATVOL_TRY(faces_->add(std::as_bytes(std::span(faces))));
  }
  return {};
}

Status PieceFaces::add(const Piece& piece, std::span<const OuterFace> outer_faces, const HashOfPoint& hash) {
  return add_faces(outer_faces, [&](const OuterFace& outer) {
    Face face{};
    std::array<dvec3, 3> positions;
    for (std::size_t c = 0; c < 3; ++c) {
      positions[c] = piece.points[outer.corners[c]] + 0.0;  // not -0
      face.corners[c] = {positions[c], hash(outer.corners[c])};
    }
    finish_face(outer, positions, face);
    return face;
  });
}

Status PieceFaces::add_cells(const Piece& piece, const HashOfPoint& hash) {
  of_cells_ = true;
  const PointCells& cells = *piece.cells;
  return add_faces(find_outer_faces(cells.corners, cells.tetrahedra), [&](const OuterFace& outer) {
    Face face{};
    std::array<dvec3, 3> positions;
    for (std::size_t c = 0; c < 3; ++c) {
      positions[c] = cells.corners[outer.corners[c]] + 0.0;  // not -0
      face.corners[c] = {positions[c], 0};
    }
    finish_face(outer, positions, face);
    const std::uint32_t point = cells.points[outer.tetrahedron];
    if (point == PointCells::no_point) face.area = dvec3(0);
    if (point != PointCells::no_point) {
      const dvec3 position = piece.points[point] + 0.0;
      face.point = {position, hash(point)};
      face.plane = {face.area, glm::dot(face.area, positions[0] - position)};
    }
    return face;
  });
}

Status PieceFaces::find_corners(ExternalSorter& faces, bool of_cells,
                                const std::function<Status(std::span<const std::byte>)>& visit) {
  std::vector<Face> of_one_key;
  MortonKey key;
  for (;;) {
    SPLATVOL_TRY_ASSIGN(sorted, faces.next());
    if (sorted.keys.empty()) return add_corners(of_one_key, of_cells, visit);
    for (std::size_t i = 0; i < sorted.keys.size(); ++i) {
      if (!of_one_key.empty() && sorted.keys[i] != key) {
        SPLATVOL_TRY(add_corners(of_one_key, of_cells, visit));
        of_one_key.clear();
      }
      key = sorted.keys[i];
      of_one_key.push_back(record_at<Face>(sorted.records, i));
    }
  }
}

Result<std::optional<ExternalSorter>> PieceFaces::take_faces() {
  if (!faces_) return std::nullopt;
  SPLATVOL_TRY(faces_->finish());
  return std::exchange(faces_, std::nullopt);
}

Result<std::optional<BoundaryCorners>> PieceFaces::join(const Cube& cube) {
  if (!faces_) return std::nullopt;
  SPLATVOL_TRY_ASSIGN(corners, sort_of_corners(cube));
  SPLATVOL_TRY(faces_->finish());
  SPLATVOL_TRY(find_corners(*faces_, of_cells_, [&](std::span<const std::byte> areas) { return corners.add(areas); }));
  faces_.reset();
  SPLATVOL_TRY(corners.finish());
  return BoundaryCorners(layout_, std::move(corners));
}

}  // namespace splatvol
