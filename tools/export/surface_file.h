// Writes triangles as a file of another program, part by part.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "base/error.h"
#include "base/math.h"
#include "base/replaceable.h"

namespace splatvol {

/// A part of a surface. Its vertices are numbered through all parts.
struct SurfacePart {
  std::span<const dvec3> points = {};                            // of new vertices
  std::vector<std::span<const double>> values = {};              // [attribute][new vertex]
  std::span<const std::array<std::uint64_t, 3>> triangles = {};  // vertices of this part and those before
  std::span<const std::array<dvec3, 3>> corners = {};            // [triangle]
};

/// A file with the mark of an export (base/replaceable.h). It appears whole or not at all.
class SurfaceFile {
 public:
  struct Attribute {
    std::string name, unit;
  };

  /// Makes a writer by the extension of `path`: .vtp, .stl or .glb. Fails if `path` may not be replaced.
  /// - .vtp: double precision, with the attributes of the points.
  /// - .stl: binary, single precision. Triangles that single precision joins to a line or a point are left out.
  /// - .glb: glTF 2.0, single precision. Fails if it would take more than 4 GiB.
  [[nodiscard]] static Result<std::unique_ptr<SurfaceFile>> create(const std::string& path,
                                                                   std::span<const Attribute> attributes,
                                                                   Replace replace);
  virtual ~SurfaceFile() = default;

  /// Whether the file has numbers of vertices. Otherwise parts need none, nor points.
  [[nodiscard]] virtual bool has_vertices() const { return true; }

  [[nodiscard]] virtual Status write(const SurfacePart& part) = 0;

  /// Returns the number of triangles so far.
  [[nodiscard]] std::uint64_t triangles() const { return triangles_; }

  /// Completes the file. Returns its bytes.
  [[nodiscard]] virtual Result<std::uint64_t> finish() = 0;

 protected:
  std::uint64_t triangles_ = 0;
};

}  // namespace splatvol
