// A convex polyhedron that planes cut down, one after the other.
#pragma once

#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "base/math.h"
#include "builder/mesh/moments.h"

namespace splatvol {

/// A convex polyhedron. Keeps its scratch memory, so that a cell costs no allocation. Not thread-safe.
class ConvexCell {
 public:
  static constexpr std::uint32_t no_label = std::numeric_limits<std::uint32_t>::max();
  struct Face {
    dvec3 normal;  // outwards, of any length
    std::uint32_t label;
    std::uint32_t begin, end;  // of its loop
  };

  /// Becomes a box, whose faces have no label.
  void reset(const dvec3& low, const dvec3& high);

  /// Keeps the part where dot(normal, x) <= offset; the new face gets the label. Returns false if nothing is cut off.
  /// Each vertex is put on one side once, so that rounding may choose the wrong side but never breaks the polyhedron.
  bool clip(const dvec3& normal, double offset, std::uint32_t label);

  [[nodiscard]] std::span<const dvec3> vertices() const { return vertices_; }
  [[nodiscard]] std::span<const Face> faces() const { return faces_; }

  /// The vertices of a face, in their order round it.
  [[nodiscard]] std::span<const std::uint32_t> loop(const Face& face) const {
    return std::span(loops_).subspan(face.begin, face.end - face.begin);
  }

  /// The moments of the volume; the centroid is relative to the origin.
  [[nodiscard]] SpatialMoments moments() const;

 private:
  struct Crossing {
    std::uint32_t inside, outside;  // the ends of the edge, by their old numbers
    std::uint32_t vertex;           // on the edge, by its new number
    std::uint32_t next;             // the next crossing round the new face
  };
  [[nodiscard]] std::uint32_t cross(std::uint32_t inside, std::uint32_t outside);
  void clip_face(const Face& face);
  void add_cap(const dvec3& normal, std::uint32_t label);

  std::vector<dvec3> vertices_;
  std::vector<Face> faces_;
  std::vector<std::uint32_t> loops_;

  // The current cut.
  std::vector<double> heights_;         // of the vertices over the plane
  std::vector<std::uint32_t> renamed_;  // new number of each vertex that stays
  std::vector<Crossing> crossings_;
  std::vector<dvec3> new_vertices_;
  std::vector<Face> new_faces_;
  std::vector<std::uint32_t> new_loops_;
};

}  // namespace splatvol
