// The triangles of a mesh's boundary to and from bytes (spec/svol-1.md, section 13).
#pragma once

#include <cstdint>
#include <span>
#include <string_view>

#include "base/error.h"
#include "base/triangle_mesh.h"
#include "format/codec.h"
#include "format/layout.h"
#include "format/volume_info.h"

namespace splatvol::format {

/// Triangles in a file: what the metadata say of them, and the section.
struct PackedBoundary {
  BoundaryInfo info;
  Bytes section;
};

/// Packs patches. `error`: how far a point of the input's boundary may be from the triangles; rounding to the grid is
/// added. Points at one position stay at one position, in different patches too. Points that no triangle names are
/// dropped. Two-sided triangles come last. Fails if there is no patch, or there are more than max_patches; if names
/// repeat; or if a patch has more than about 3e8 points and triangles. Requires indices in range, and coordinates of at
/// most 1e50.
[[nodiscard]] Result<PackedBoundary> pack_boundary(std::span<const Patch> patches, double error);

/// Returns the bytes of a patch before packing.
[[nodiscard]] constexpr std::uint64_t payload_bytes(const PatchInfo& patch) {
  return patch_element_bytes * (patch.points + patch.triangles);
}

/// Checks and unpacks a patch, and appends it to `mesh`. Requires that part.unpacked_bytes is payload_bytes, within
/// check_ratio. `what` begins the message of an error. Holds at most 48 MiB besides the mesh. Can be interrupted. Safe
/// on untrusted `packed`. After a failure, `mesh` holds anything.
[[nodiscard]] Status append_patch(const BoundaryInfo& boundary, std::size_t patch, const PatchPart& part,
                                  std::span<const std::byte> packed, TriangleMesh& mesh, std::string_view what);

/// Checks a patch in the same way, without a mesh.
[[nodiscard]] Status check_patch(const BoundaryInfo& boundary, std::size_t patch, const PatchPart& part,
                                 std::span<const std::byte> packed, std::string_view what);

}  // namespace splatvol::format
