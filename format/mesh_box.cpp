#include "format/mesh_box.h"

#include "format/cell_reader.h"
#include "format/splat_reader.h"

namespace splatvol::format {
namespace {

constexpr std::uint64_t most_points = 1 << 20;

Result<Box> box_of_points(const Volume& volume) {
  SplatSelection selection;
  selection.resolution = volume.info().finest_within(most_points);
  const SplatReader reader(volume, selection, own_room(splat_reader_bytes));
  Box box;
  for (std::uint64_t g = 0; g < reader.group_count(); ++g) {
    SPLATVOL_TRY_ASSIGN(group, reader.read(g, {.positions = true}));
    for (const dvec3& position : group.positions) box.include({position, position});
  }
  return box;
}

}  // namespace

Result<std::optional<Box>> box_of_cells(const Volume& volume) {
  SPLATVOL_TRY_ASSIGN(cells, CellReader::open(volume));
  if (!cells || cells->pages().empty()) return std::nullopt;
  Box box;
  for (const CellPageRef& page : cells->pages())
    box.include({{page.low[0], page.low[1], page.low[2]}, {page.high[0], page.high[1], page.high[2]}});
  return std::optional(box);
}

Result<Box> mesh_box(const Volume& volume) {
  SPLATVOL_TRY_ASSIGN(box, box_of_cells(volume));
  return box ? Result<Box>(*box) : box_of_points(volume);
}

}  // namespace splatvol::format
