// The boundary on its way into a file.
#pragma once

#include <memory>
#include <string>

#include "base/error.h"
#include "builder/boundary/boundary_faces.h"
#include "builder/pipeline/build.h"
#include "builder/sources/source.h"
#include "format/boundary.h"

namespace splatvol {

/// Makes an empty boundary for the pieces to come, with a part of the memory; null if the options ask for none. Fails
/// if the source cannot have cells; with BuildOptions::boundary_if_any, that gives null, too.
[[nodiscard]] Result<std::unique_ptr<BoundaryFaces>> start_boundary(const Source& source, const BuildOptions& options,
                                                                    const std::string& folder);

/// Adds the faces of each piece to `faces`, and takes its patches away; empty without faces.
[[nodiscard]] inline WatchPiece faces_of(BoundaryFaces* faces) {
  if (!faces) return {};
  return [faces](Piece& piece) {
    Status added = faces->add(piece);
    piece.patches = {};
    return added;
  };
}

/// Fails if no piece had a face; with BuildOptions::boundary_if_any, makes `faces` null instead. Does nothing for null.
/// Called after the last piece.
[[nodiscard]] Status check_boundary(std::unique_ptr<BoundaryFaces>& faces, const BuildOptions& options);

/// A boundary that is ready for the file.
struct StoredBoundary {
  format::PackedBoundary packed;
  BoundaryReport report;
  std::uint64_t held_bytes = 0;  // memory that it took, about
};

/// Simplifies and packs the boundary of all pieces. Called once. Fails if the pieces had no cells.
[[nodiscard]] Result<StoredBoundary> finish_boundary(BoundaryFaces& faces, const BuildOptions& options,
                                                     const BuildProgress& progress);

}  // namespace splatvol
