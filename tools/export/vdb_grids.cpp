#include "tools/export/vdb_grids.h"

#include <fmt/format.h>
#include <openvdb/openvdb.h>

#include <array>
#include <cerrno>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <ios>
#include <system_error>

#include "base/file.h"
#include "base/vdb_grid.h"
#include "base/vdb_share.h"
#include "format/codec.h"

namespace splatvol {
namespace {

using Leaf = openvdb::FloatTree::LeafNodeType;

// OpenVDB gives every file a random number. It is replaced by a hash.
std::string uuid_of(std::uint64_t hash) {
  return fmt::format("{:08x}-{:04x}-8{:03x}-8000-{:012x}", hash >> 32, hash >> 16 & 0xFFFF, hash >> 4 & 0xFFF,
                     hash & 0xFFFFFFFFFFFF);
}

// OpenVDB's own file class does not report a full disk. A stream that throws does.
class Archive final : public openvdb::io::Archive {
 public:
  void write_file(const std::string& path, const openvdb::GridCPtrVec& grids, const std::string& mark) const {
    openvdb::MetaMap metadata;
    metadata.insertMeta("export", openvdb::StringMetadata(mark));
    std::ofstream file(path, std::ios::binary);
    file.exceptions(std::ios::failbit | std::ios::badbit);
    write(file, grids, true, metadata);
    file.close();
  }
};

}  // namespace

struct VdbGrids::Grids {
  std::vector<openvdb::FloatGrid::Ptr> all;
  std::uint64_t hash = 0;  // of names and bricks
};

VdbGrids::VdbGrids(const std::vector<std::string>& names, const dvec3& origin, double voxel)
    : grids_(std::make_unique<Grids>()) {
  openvdb::initialize();
  for (const std::string& name : names) {
    const openvdb::FloatGrid::Ptr grid = make_vdb_grid<openvdb::FloatGrid>();
    grid->setName(name);
    grid->setGridClass(openvdb::GRID_FOG_VOLUME);
    const openvdb::math::Transform::Ptr transform = openvdb::math::Transform::createLinearTransform(voxel);
    transform->postTranslate({origin.x, origin.y, origin.z});
    grid->setTransform(transform);
    grids_->all.push_back(grid);
    grids_->hash ^= format::hash_bytes(std::as_bytes(std::span(name))) + grids_->all.size();
  }
}

VdbGrids::~VdbGrids() = default;

void VdbGrids::add_brick(std::size_t grid, const std::array<std::int32_t, 3>& first,
                         const std::array<float, 512>& values) {
  auto leaf = std::make_unique<Leaf>(openvdb::Coord(first[0], first[1], first[2]), 0.0F, false);
  for (openvdb::Index voxel = 0; voxel < values.size(); ++voxel)
    if (!std::isnan(values[voxel])) leaf->setValueOn(voxel, values[voxel]);
  if (leaf->isEmpty()) return;
  const std::array<std::uint64_t, 4> parts = {grids_->hash, grid, format::hash_bytes(std::as_bytes(std::span(first))),
                                              format::hash_bytes(std::as_bytes(std::span(values)))};
  grids_->hash = format::hash_bytes(std::as_bytes(std::span(parts)));
  grids_->all[grid]->tree().addLeaf(leaf.release());
}

void VdbGrids::mark_share(std::size_t grid) {
  grids_->all[grid]->insertMeta(vdb_share_metadata, openvdb::BoolMetadata(true));
}

void VdbGrids::set_unit(std::size_t grid, const std::string& unit) {
  grids_->all[grid]->insertMeta("unit", openvdb::StringMetadata(unit));
}

Result<std::uint64_t> VdbGrids::write(const std::string& path, Replace replace) const {
  SPLATVOL_TRY_ASSIGN(file, AtomicFile::create(path, AtomicFile::Unnamed::if_possible, replace));
  const std::string uuid = uuid_of(grids_->hash);
  try {
    Archive().write_file(file.path_to_write(), {grids_->all.begin(), grids_->all.end()}, vdb_export_mark(uuid));
  } catch (const std::bad_alloc&) {
    return fail(ErrorCode::out_of_budget, "{}: not enough memory to write it", path);
  } catch (const std::ios_base::failure&) {
    return fail(ErrorCode::io, "{}: cannot write: {}", path, std::system_category().message(errno));
  } catch (const std::exception& error) {
    return fail(ErrorCode::io, "{}: cannot write: {}", path, error.what());
  }
  SPLATVOL_TRY(file.write_at(vdb_uuid_offset, std::as_bytes(std::span(uuid))));
  SPLATVOL_TRY(file.commit());
  std::error_code error;
  return std::filesystem::file_size(path, error);
}

}  // namespace splatvol
