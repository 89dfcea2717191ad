#include "builder/mesh/tetrahedra.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include "builder/mesh/usable_numbers.h"

namespace splatvol {
namespace {

/// Inverted volume below this share of the cell's volume comes from rounded coordinates.
constexpr double rounding_share = 1e-6;

using Face = std::vector<std::uint8_t>;  // local nodes, counterclockwise from outside
using Faces = std::vector<Face>;
using Edge = std::pair<std::uint8_t, std::uint8_t>;

struct Shape {
  std::string_view name;
  std::size_t nodes;
  std::vector<Faces> parts;  // closed surfaces that fill the cell together
};

const Faces tetrahedron_faces = {{0, 1, 3}, {1, 2, 3}, {2, 0, 3}, {0, 2, 1}};
const Faces hexahedron_faces = {{0, 4, 7, 3}, {1, 2, 6, 5}, {0, 1, 5, 4}, {3, 7, 6, 2}, {0, 3, 2, 1}, {4, 5, 6, 7}};
const Faces voxel_faces = {{0, 4, 6, 2}, {1, 3, 7, 5}, {0, 1, 5, 4}, {2, 6, 7, 3}, {0, 2, 3, 1}, {4, 5, 7, 6}};
const Faces wedge_faces = {{0, 1, 2}, {3, 5, 4}, {0, 3, 4, 1}, {1, 4, 5, 2}, {2, 5, 3, 0}};
const Faces pyramid_faces = {{0, 3, 2, 1}, {0, 1, 4}, {1, 2, 4}, {2, 3, 4}, {3, 0, 4}};

/// In a quadratic cell with n corners, node n + i lies on edge i.
const std::vector<Edge> tetrahedron_edges = {{0, 1}, {1, 2}, {2, 0}, {0, 3}, {1, 3}, {2, 3}};
const std::vector<Edge> hexahedron_edges = {{0, 1}, {1, 2}, {2, 3}, {3, 0}, {4, 5}, {5, 6},
                                            {6, 7}, {7, 4}, {0, 4}, {1, 5}, {2, 6}, {3, 7}};
const std::vector<Edge> wedge_edges = {{0, 1}, {1, 2}, {2, 0}, {3, 4}, {4, 5}, {5, 3}, {0, 3}, {1, 4}, {2, 5}};
const std::vector<Edge> pyramid_edges = {{0, 1}, {1, 2}, {2, 3}, {3, 0}, {0, 4}, {1, 4}, {2, 4}, {3, 4}};

Faces prism_faces(std::uint8_t sides) {
  Face bottom, top;
  Faces faces;
  for (std::uint8_t i = 0; i < sides; ++i) {
    const auto next = static_cast<std::uint8_t>((i + 1) % sides);
    bottom.insert(bottom.begin(), i);
    top.push_back(static_cast<std::uint8_t>(sides + i));
    faces.push_back({i, next, static_cast<std::uint8_t>(sides + next), static_cast<std::uint8_t>(sides + i)});
  }
  faces.push_back(bottom);
  faces.push_back(top);
  return faces;
}

/// Puts the sides of the polygon around a corner in order; each side runs from one mid-edge node to the next.
Face chain(std::vector<Edge> sides) {
  Face polygon{sides.back().first};
  while (polygon.size() < sides.size()) {
    const auto side = std::ranges::find(sides, polygon.back(), &Edge::first);
    polygon.push_back(side->second);
  }
  return polygon;
}

/// Cuts a quadratic cell into a cap for each corner and the core between the mid-edge nodes.
std::vector<Faces> cut_corners(const Faces& faces, const std::vector<Edge>& edges, std::uint8_t corners) {
  const auto middle = [&](std::uint8_t a, std::uint8_t b) {
    const auto edge = std::ranges::find_if(edges, [&](Edge e) { return e == Edge{a, b} || e == Edge{b, a}; });
    return static_cast<std::uint8_t>(corners + (edge - edges.begin()));
  };

  std::vector<Faces> parts(corners);
  std::vector<std::vector<Edge>> cut_sides(corners);
  Faces core;
  for (const Face& face : faces) {
    Face inner;
    for (std::size_t i = 0; i < face.size(); ++i) {
      const std::uint8_t corner = face[i];
      const std::uint8_t before = middle(face[(i + face.size() - 1) % face.size()], corner);
      const std::uint8_t after = middle(corner, face[(i + 1) % face.size()]);
      parts[corner].push_back({before, corner, after});
      cut_sides[corner].push_back({before, after});
      inner.push_back(after);
    }
    core.push_back(inner);
  }
  for (std::uint8_t corner = 0; corner < corners; ++corner) {
    Face cut = chain(cut_sides[corner]);
    parts[corner].push_back(cut);
    std::ranges::reverse(cut);
    core.push_back(cut);
  }
  parts.push_back(core);
  return parts;
}

/// The faces of a part of a cell. `nodes`: those of the cell that are its nodes.
Faces faces_at(Faces faces, const Face& nodes) {
  for (Face& face : faces)
    for (std::uint8_t& node : face) node = nodes[node];
  return faces;
}

/// Cuts a biquadratic hexahedron at half its height. Each half is a wedge for each upright edge and a core between
/// them, so that its faces are cut as those of its neighbours: base and top as of quadratic cells, the sides into
/// quarters.
std::vector<Faces> cut_hexahedron() {
  constexpr std::array<std::uint8_t, 4> sides = {22, 21, 23, 20};  // side i is between the corners i and i + 1
  std::vector<Faces> parts;
  for (const bool upper : {false, true}) {
    Face core(8);
    for (std::uint8_t i = 0; i < 4; ++i) {
      const auto before = static_cast<std::uint8_t>((i + 3) % 4);
      const auto first = static_cast<std::uint8_t>(upper ? 12 : 8);  // edge of the base or top
      const std::uint8_t corner = upper ? i + 4 : i, edge = 16 + i;
      const Face base = {corner, static_cast<std::uint8_t>(first + before), static_cast<std::uint8_t>(first + i)};
      const Face middle = {edge, sides[before], sides[i]};
      const Face& low = upper ? middle : base;
      const Face& high = upper ? base : middle;
      parts.push_back(faces_at(wedge_faces, {low[0], low[1], low[2], high[0], high[1], high[2]}));
      core[i] = low[2];
      core[i + 4u] = high[2];
    }
    parts.push_back(faces_at(hexahedron_faces, core));
  }
  return parts;
}

/// Cuts a triquadratic pyramid into a part for each piece of its surface, from its middle: the base in quarters, each
/// side as corners and three triangles between the middles.
std::vector<Faces> cut_pyramid() {
  constexpr std::uint8_t base = 13, middle = 18, top = 4;
  std::vector<Faces> parts;
  const auto add_triangle = [&](std::uint8_t a, std::uint8_t b, std::uint8_t c) {
    parts.push_back(faces_at(tetrahedron_faces, {a, c, b, middle}));
  };
  for (std::uint8_t i = 0; i < 4; ++i) {
    const auto next = static_cast<std::uint8_t>((i + 1) % 4), before = static_cast<std::uint8_t>((i + 3) % 4);
    const auto edge = static_cast<std::uint8_t>(5 + i), edge_before = static_cast<std::uint8_t>(5 + before);
    const auto up = static_cast<std::uint8_t>(9 + i), up_next = static_cast<std::uint8_t>(9 + next);
    const auto side = static_cast<std::uint8_t>(14 + i);
    parts.push_back(faces_at(pyramid_faces, {i, edge, base, edge_before, middle}));
    add_triangle(i, edge, up);
    add_triangle(next, up_next, edge);
    add_triangle(top, up, up_next);
    add_triangle(edge, up_next, side);
    add_triangle(up_next, up, side);
    add_triangle(up, edge, side);
  }
  return parts;
}

const Shape& shape_of(CellShape shape) {
  static const std::array<Shape, 13> shapes = {{
      {"tetrahedron", 4, {tetrahedron_faces}},
      {"voxel", 8, {voxel_faces}},
      {"hexahedron", 8, {hexahedron_faces}},
      {"wedge", 6, {wedge_faces}},
      {"pyramid", 5, {pyramid_faces}},
      {"pentagonal prism", 10, {prism_faces(5)}},
      {"hexagonal prism", 12, {prism_faces(6)}},
      {"quadratic tetrahedron", 10, cut_corners(tetrahedron_faces, tetrahedron_edges, 4)},
      {"quadratic hexahedron", 20, cut_corners(hexahedron_faces, hexahedron_edges, 8)},
      {"quadratic wedge", 15, cut_corners(wedge_faces, wedge_edges, 6)},
      {"quadratic pyramid", 13, cut_corners(pyramid_faces, pyramid_edges, 5)},
      {"biquadratic hexahedron", 24, cut_hexahedron()},
      {"triquadratic pyramid", 19, cut_pyramid()},
  }};
  return shapes[static_cast<std::size_t>(shape)];
}

/// The shape by which a file keeps cells as such; none: it keeps their tetrahedra.
std::optional<format::CellShape> kept_shape(CellShape shape) {
  switch (shape) {
    case CellShape::voxel:
    case CellShape::hexahedron:
      return format::CellShape::hexahedron;
    case CellShape::wedge:
      return format::CellShape::wedge;
    case CellShape::pyramid:
      return format::CellShape::pyramid;
    default:
      return std::nullopt;
  }
}

/// Calls visit(first, count) for each face of a list "count, vertices, count, vertices, ...".
template <class Visit>
void for_each_face(const std::vector<std::uint32_t>& faces, const Visit& visit) {
  for (std::size_t at = 0; at < faces.size(); at += faces[at] + 1) visit(at + 1, faces[at]);
}

/// Spreads a key over 64 bits (the finaliser of SplitMix64).
std::uint64_t mix(std::uint64_t key) {
  key = (key ^ key >> 30) * 0xbf58476d1ce4e5b9;
  key = (key ^ key >> 27) * 0x94d049bb133111eb;
  return key ^ key >> 31;
}

/// A side of a polyhedron's face, to be matched with the face beyond.
struct Side {
  std::uint32_t low, high;  // vertices
  std::uint32_t face;
  bool forward;  // the face runs from low to high
};

}  // namespace

std::size_t node_count(CellShape shape) { return shape_of(shape).nodes; }
std::string_view shape_name(CellShape shape) { return shape_of(shape).name; }

void TetrahedronSplitter::split(CellShape shape, std::span<const std::uint32_t> nodes) {
  if (!finite(nodes)) {
    ++census_.non_finite;
    return;
  }
  if (shape == CellShape::tetrahedron) {
    const double volume = signed_volume_6(points_[nodes[0]], points_[nodes[1]], points_[nodes[2]], points_[nodes[3]]);
    emit_tetrahedron({nodes[0], nodes[1], nodes[2], nodes[3]}, volume, 0);
    return;
  }
  const std::size_t first = tetrahedra_.size();
  const bool either_orientation = shape == CellShape::wedge || shape == CellShape::quadratic_wedge;
  for (const Faces& part : shape_of(shape).parts) {
    faces_.clear();
    for (const Face& face : part) {
      faces_.push_back(static_cast<std::uint32_t>(face.size()));
      for (const std::uint8_t node : face) faces_.push_back(nodes[node]);
    }
    split_faces(either_orientation);
  }
  if (whole_cells_ && tetrahedra_.size() > first) list_whole_cell(shape, nodes, first);
}

// The tetrahedra from the first on are those of the cell.
void TetrahedronSplitter::list_whole_cell(CellShape shape, std::span<const std::uint32_t> nodes, std::size_t first) {
  const auto kept = kept_shape(shape);
  if (!kept) return is_linear(shape) ? list_polyhedron(first) : void();
  WholeCell cell{.shape = *kept, .first = static_cast<std::uint32_t>(first), .count = 0};
  std::ranges::copy(nodes, cell.corners.begin());
  if (shape == CellShape::voxel) {  // its faces list their corners line by line
    std::swap(cell.corners[2], cell.corners[3]);
    std::swap(cell.corners[6], cell.corners[7]);
  }
  const auto corners = std::span(cell.corners).first(nodes.size());
  for (std::size_t i = 0; i < corners.size(); ++i)
    if (std::ranges::find(corners.subspan(i + 1), corners[i]) != corners.end()) return;
  cell.count = static_cast<std::uint32_t>(tetrahedra_.size() - first);
  const std::uint32_t apex = tetrahedra_.back()[3];
  cell.split = static_cast<format::CellSplit>(std::ranges::find(corners, apex) - corners.begin());
  const auto faces = format::quadrilaterals_of(cell.shape);
  for (std::size_t f = 0; f < faces.size(); ++f) {
    const auto lowest = std::ranges::min_element(
        faces[f], [&](std::uint8_t a, std::uint8_t b) { return lower(cell.corners[a], cell.corners[b]); });
    if ((lowest - faces[f].begin()) % 2 == 1) cell.split = static_cast<format::CellSplit>(cell.split | 8u << f);
  }
  whole_cells_->push_back(cell);
}

void TetrahedronSplitter::list_polyhedron(std::size_t first) {
  const std::size_t count = tetrahedra_.size() - first;
  if (count < 2) return;
  whole_cells_->push_back({.shape = format::CellShape::polyhedron,
                           .first = static_cast<std::uint32_t>(first),
                           .count = static_cast<std::uint32_t>(count)});
}

void TetrahedronSplitter::split_polyhedron(std::span<const std::uint32_t> faces) {
  faces_.assign(faces.begin(), faces.end());
  bool all_finite = true;
  for_each_face(faces_, [&](std::size_t first, std::size_t count) {
    all_finite = all_finite && finite(std::span(faces_).subspan(first, count));
  });
  if (!all_finite) {
    ++census_.non_finite;
    return;
  }
  if (!faces_agree()) orient_faces();
  const std::size_t first = tetrahedra_.size();
  split_faces(true);
  if (whole_cells_) list_polyhedron(first);
}

std::span<const TetrahedronSplitter::Triangle> TetrahedronSplitter::split_face(std::span<const std::uint32_t> face) {
  faces_.assign(1, static_cast<std::uint32_t>(face.size()));
  faces_.insert(faces_.end(), face.begin(), face.end());
  triangulate_faces();
  return triangles_;
}

void TetrahedronSplitter::split_faces(bool either_orientation) {
  collect_vertices();
  triangulate_faces();
  if (split_from_any_vertex(either_orientation)) return;

  const auto inverted = [&](std::uint32_t apex) { return volumes_from(apex).inverted(); };
  const std::uint32_t best = *std::ranges::min_element(vertices_, {}, inverted);
  emit(best, volumes_from(best), either_orientation);
  ++census_.not_star_shaped;
}

bool TetrahedronSplitter::split_from_any_vertex(bool either_orientation) {
  for (const std::uint32_t apex : vertices_) {
    const Volumes volumes = volumes_from(apex);
    if (volumes.inverted() > rounding_share * volumes.total()) continue;
    emit(apex, volumes, either_orientation);
    return true;
  }
  return vertices_.empty();
}

void TetrahedronSplitter::collect_vertices() {
  vertices_.clear();
  for_each_face(faces_, [&](std::size_t first, std::size_t count) {
    vertices_.insert(vertices_.end(), faces_.begin() + static_cast<std::ptrdiff_t>(first),
                     faces_.begin() + static_cast<std::ptrdiff_t>(first + count));
  });
  std::ranges::sort(vertices_);
  vertices_.erase(std::ranges::unique(vertices_).begin(), vertices_.end());
  std::ranges::sort(vertices_, [this](std::uint32_t a, std::uint32_t b) { return lower(a, b); });
}

void TetrahedronSplitter::triangulate_faces() {
  triangles_.clear();
  for_each_face(faces_, [&](std::size_t first, std::size_t count) {
    const auto face = std::span(faces_).subspan(first, count);
    if (count < 3) return;
    const std::size_t start = fan_start(face);
    for (std::size_t i = 1; i + 1 < count; ++i) {
      const Triangle triangle{face[start], face[(start + i) % count], face[(start + i + 1) % count]};
      if (triangle[0] != triangle[1] && triangle[1] != triangle[2] && triangle[2] != triangle[0])
        triangles_.push_back(triangle);
    }
  });
}

std::size_t TetrahedronSplitter::fan_start(std::span<const std::uint32_t> face) {
  const auto by_position = [this](std::uint32_t a, std::uint32_t b) { return lower(a, b); };
  const auto lowest = static_cast<std::size_t>(std::ranges::min_element(face, by_position) - face.begin());
  if (face.size() <= 4) return lowest;

  // The cell beyond has the face the other way round. Both cells go over it in one order, so that rounding agrees.
  polygon_.assign(face.begin(), face.end());
  std::ranges::rotate(polygon_, polygon_.begin() + static_cast<std::ptrdiff_t>(lowest));
  if (lower(polygon_.back(), polygon_[1])) std::reverse(polygon_.begin() + 1, polygon_.end());
  dvec3 normal(0);
  for (std::size_t i = 1; i + 1 < polygon_.size(); ++i)
    normal += glm::cross(points_[polygon_[i]] - points_[polygon_[0]], points_[polygon_[i + 1]] - points_[polygon_[0]]);
  if (fans_out(polygon_, 0, normal)) return lowest;

  std::optional<std::uint32_t> best;
  for (std::size_t i = 1; i < polygon_.size(); ++i)
    if (fans_out(polygon_, i, normal) && (!best || lower(polygon_[i], *best))) best = polygon_[i];
  return best ? static_cast<std::size_t>(std::ranges::find(face, *best) - face.begin()) : lowest;
}

bool TetrahedronSplitter::fans_out(std::span<const std::uint32_t> face, std::size_t start, dvec3 normal) const {
  const dvec3 apex = points_[face[start]];
  const double least = -rounding_share * glm::dot(normal, normal);
  for (std::size_t i = 1; i + 1 < face.size(); ++i) {
    const dvec3 a = points_[face[(start + i) % face.size()]] - apex;
    const dvec3 b = points_[face[(start + i + 1) % face.size()]] - apex;
    if (glm::dot(glm::cross(a, b), normal) < least) return false;
  }
  return true;
}

bool TetrahedronSplitter::faces_agree() const {
  // If the faces agree, they run along every edge once in each direction, and its hash cancels. Else it hardly does.
  std::uint64_t balance = 0;
  for_each_face(faces_, [&](std::size_t first, std::size_t count) {
    for (std::size_t i = 0; i < count; ++i) {
      const std::uint32_t a = faces_[first + i];
      const std::uint32_t b = faces_[first + (i + 1) % count];
      const std::uint64_t hash = mix(static_cast<std::uint64_t>(std::min(a, b)) << 32 | std::max(a, b));
      balance += a < b ? hash : -hash;
    }
  });
  return balance == 0;
}

void TetrahedronSplitter::orient_faces() {
  std::vector<Side> sides;
  std::vector<std::size_t> starts;
  for_each_face(faces_, [&](std::size_t first, std::size_t count) {
    for (std::size_t i = 0; i < count; ++i) {
      const std::uint32_t a = faces_[first + i];
      const std::uint32_t b = faces_[first + (i + 1) % count];
      sides.push_back({std::min(a, b), std::max(a, b), static_cast<std::uint32_t>(starts.size()), a < b});
    }
    starts.push_back(first);
  });
  const auto edge = [](const Side& side) { return std::pair(side.low, side.high); };
  std::ranges::sort(sides, {}, edge);

  // From the first face outwards: the face beyond a shared edge must run along it the other way. A polyhedron has so
  // few faces that a scan of all sides costs less than an index.
  enum : std::uint8_t { unknown, kept, turned };
  std::vector<std::uint8_t> state(starts.size(), unknown);
  state[0] = kept;
  for (bool grown = true; grown;) {
    grown = false;
    for (std::size_t i = 0; i + 1 < sides.size(); ++i) {
      if (edge(sides[i]) != edge(sides[i + 1])) continue;
      for (const auto& [from, to] : {std::pair(sides[i], sides[i + 1]), std::pair(sides[i + 1], sides[i])}) {
        if (state[from.face] == unknown || state[to.face] != unknown) continue;
        const bool agree = from.forward != to.forward;
        state[to.face] = agree == (state[from.face] == kept) ? kept : turned;
        grown = true;
      }
    }
  }
  for (std::size_t face = 0; face < starts.size(); ++face) {
    if (state[face] != turned) continue;
    const auto first = faces_.begin() + static_cast<std::ptrdiff_t>(starts[face]);
    std::reverse(first, first + faces_[starts[face] - 1]);
  }
}

bool TetrahedronSplitter::lower(std::uint32_t a, std::uint32_t b) const {
  const dvec3& p = points_[a];
  const dvec3& q = points_[b];
  if (p.x != q.x) return p.x < q.x;
  if (p.y != q.y) return p.y < q.y;
  if (p.z != q.z) return p.z < q.z;
  return a < b;
}

bool TetrahedronSplitter::finite(std::span<const std::uint32_t> nodes) const {
  return std::ranges::all_of(nodes, [this](std::uint32_t node) { return is_usable_position(points_[node]); });
}

double TetrahedronSplitter::volume_6(std::uint32_t apex, const Triangle& triangle) const {
  // The triangle runs counterclockwise from outside, and so clockwise from the apex.
  return signed_volume_6(points_[triangle[0]], points_[triangle[2]], points_[triangle[1]], points_[apex]);
}

TetrahedronSplitter::Volumes TetrahedronSplitter::volumes_from(std::uint32_t apex) const {
  Volumes volumes;
  for (const Triangle& triangle : triangles_) {
    const double volume = volume_6(apex, triangle);
    (volume < 0 ? volumes.negative : volumes.positive) += std::abs(volume);
  }
  return volumes;
}

void TetrahedronSplitter::emit(std::uint32_t apex, const Volumes& volumes, bool either_orientation) {
  const double sign = either_orientation && volumes.negative > volumes.positive ? -1 : 1;
  for (const Triangle& triangle : triangles_) {
    if (std::ranges::find(triangle, apex) != triangle.end()) continue;
    emit_tetrahedron({triangle[0], triangle[2], triangle[1], apex}, sign * volume_6(apex, triangle),
                     rounding_share * volumes.total());
  }
}

void TetrahedronSplitter::emit_tetrahedron(const Tetrahedron& tetrahedron, double oriented_volume, double rounding) {
  const auto& [a, b, c, d] = tetrahedron;
  if (a == b || a == c || a == d || b == c || b == d || c == d) return;
  tetrahedra_.push_back(tetrahedron);
  ++census_.tetrahedra;
  if (oriented_volume == 0) ++census_.flat;
  if (oriented_volume < -rounding) ++census_.inverted;
  if (oriented_volume > rounding) ++census_.upright;
}

}  // namespace splatvol
