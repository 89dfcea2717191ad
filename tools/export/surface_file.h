// Writes triangles as a file of another program, part by part.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>

#include "base/error.h"
#include "base/replaceable.h"
#include "extractor/contour_extraction.h"
#include "extractor/output_arrays.h"

namespace splatvol {

/// A file with the mark of an export (base/replaceable.h). It appears whole or not at all.
class SurfaceFile : public SurfaceOutput {
 public:
  /// Makes a writer by the extension of `path`: .vtp, .stl or .glb. Fails if `path` may not be replaced.
  /// - .vtp: double precision, with the arrays of the points.
  /// - .stl: binary, single precision. Triangles that single precision joins to a line or a point are left out.
  /// - .glb: glTF 2.0, single precision. Fails if it would take more than 4 GiB.
  [[nodiscard]] static Result<std::unique_ptr<SurfaceFile>> create(const std::string& path,
                                                                   std::span<const OutputArray> arrays,
                                                                   Replace replace);
  /// Completes the file. Returns its bytes.
  [[nodiscard]] virtual Result<std::uint64_t> finish() = 0;
};

}  // namespace splatvol
