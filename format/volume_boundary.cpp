// The boundary of a volume.
#include <fmt/format.h>

#include <numeric>

#include "base/sizes.h"
#include "format/boundary.h"
#include "format/volume.h"

namespace splatvol::format {
namespace {

// Several patches are read at once up to this size.
constexpr std::uint64_t most_patch_bytes = 4u << 20;

}  // namespace

// The parts follow the table without gaps.
Result<std::vector<PatchPart>> Volume::read_patch_table() const {
  const std::vector<PatchInfo>& patches = info_.boundary->patches;
  const SectionEntry& section = *file_->find_section(SectionKind::boundary);
  const std::uint64_t bytes = sizeof(std::uint64_t) + patches.size() * sizeof(PatchPart);
  if (bytes > section.packed_bytes) return broken("the boundary is too short [R21]");
  SPLATVOL_TRY_ASSIGN(table, file_->read_bytes(section.offset, bytes));
  if (hash_bytes(std::span(table).subspan(sizeof(std::uint64_t))) != read_record<std::uint64_t>(table, 0))
    return broken("table of patches: checksum mismatch [R21]");
  std::vector<PatchPart> parts;
  std::uint64_t left = section.packed_bytes - bytes;
  for (std::size_t i = 0; i < patches.size(); ++i) {
    const auto part = read_record<PatchPart>(table, sizeof(std::uint64_t) + i * sizeof(PatchPart));
    if (part.packed_bytes > part.unpacked_bytes || part.unpacked_bytes != payload_bytes(patches[i]))
      return broken("a patch has the wrong length [R21]");
    SPLATVOL_TRY(check_ratio(part.packed_bytes, part.unpacked_bytes, what_patch(i)));
    if (part.packed_bytes > left) return broken("the patches do not tile their section [R21]");
    left -= part.packed_bytes;
    parts.push_back(part);
  }
  if (left > 0) return broken("the patches do not tile their section [R21]");
  return parts;
}

std::string Volume::what_patch(std::size_t patch) const {
  return fmt::format("{}: patch \"{}\"", name(), info_.boundary->patches[patch].name);
}

// Calls visit(patch, its part, its packed bytes) for patches, in their order. Patches that follow each other are one
// read: from a server, each has a price.
template <class Visit>
Status Volume::visit_patches(std::span<const PatchPart> parts, std::span<const std::size_t> patches,
                             const Visit& visit) const {
  std::vector<std::uint64_t> offsets = {file_->find_section(SectionKind::boundary)->offset + sizeof(std::uint64_t) +
                                        parts.size() * sizeof(PatchPart)};
  for (const PatchPart& part : parts) offsets.push_back(offsets.back() + part.packed_bytes);
  for (std::size_t begin = 0, end = 0; begin < patches.size(); begin = end) {
    const std::uint64_t first = offsets[patches[begin]];
    for (end = begin + 1; end < patches.size() && patches[end] == patches[end - 1] + 1; ++end)
      if (offsets[patches[end] + 1] - first > most_patch_bytes) break;
    SPLATVOL_TRY_ASSIGN(bytes, file_->read_bytes(first, offsets[patches[end - 1] + 1] - first));
    for (std::size_t i = begin; i < end; ++i) {
      const PatchPart& part = parts[patches[i]];
      SPLATVOL_TRY(
          visit(patches[i], part,
                std::span(bytes).subspan(static_cast<std::size_t>(offsets[patches[i]] - first), part.packed_bytes)));
    }
  }
  return {};
}

Result<TriangleMesh> Volume::read_boundary(std::span<const std::size_t> patches) const {
  const std::size_t count = info_.boundary ? info_.boundary->patches.size() : 0;
  for (const std::size_t patch : patches)
    if (patch >= count) return fail(ErrorCode::invalid_argument, "{}: no patch {}", name(), patch);
  TriangleMesh mesh;
  if (patches.empty()) return mesh;
  SPLATVOL_TRY_ASSIGN(parts, read_patch_table());
  std::uint64_t points = 0, triangles = 0;
  for (const std::size_t patch : patches) {
    points += info_.boundary->patches[patch].points;
    triangles += info_.boundary->patches[patch].triangles;
  }
  SPLATVOL_TRY_ASSIGN(point_count, as_size(points, name()));
  SPLATVOL_TRY_ASSIGN(triangle_count, as_size(triangles, name()));
  mesh.points.reserve(point_count);
  mesh.triangles.reserve(triangle_count);
  SPLATVOL_TRY(visit_patches(
      parts, patches, [&](std::size_t patch, const PatchPart& part, std::span<const std::byte> packed) -> Status {
        return append_patch(*info_.boundary, patch, part, packed, mesh, what_patch(patch));
      }));
  return mesh;
}

Status Volume::check_boundary() const {
  if (!info_.boundary) return {};
  SPLATVOL_TRY_ASSIGN(parts, read_patch_table());
  std::vector<std::size_t> patches(parts.size());
  std::iota(patches.begin(), patches.end(), std::size_t{0});
  return visit_patches(parts, patches,
                       [&](std::size_t patch, const PatchPart& part, std::span<const std::byte> packed) -> Status {
                         return check_patch(*info_.boundary, patch, part, packed, what_patch(patch));
                       });
}

}  // namespace splatvol::format
