#include "player/scene_surfaces.h"

#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <iterator>
#include <map>
#include <utility>

#include "base/names.h"
#include "sampler/cell_sampler.h"
#include "sampler/cell_tetrahedra.h"

namespace splatvol {
namespace {

constexpr std::size_t most_names = 4;  // in a message

// The patches of a boundary that a surface shows.
struct PatchChoice {
  std::vector<std::size_t> patches;   // ascending
  std::vector<std::string> left_out;  // the smallest first
};
using PatchChoices = std::map<std::string, PatchChoice>;  // by SceneSurface::boundary

bool is_boundary(const SceneSurface& style) { return !style.boundary.empty(); }

Result<std::vector<std::size_t>> patches_of(const format::Volume& volume, const std::string& pattern) {
  if (!volume.info().boundary)
    return fail(ErrorCode::invalid_argument,
                "{}: holds no boundary, and so no patch \"{}\": svbuild --boundary keeps it", volume.name(), pattern);
  std::vector<std::string> names;
  for (const format::PatchInfo& patch : volume.info().boundary->patches) names.push_back(patch.name);
  return find_patches(volume.name(), pattern, names);
}

// Chooses the patches of all surfaces that are shown, the smallest first, and takes their bytes from `room`.
Result<PatchChoices> choose_patches(std::span<const SceneSurface> styles, const format::Volume& volume,
                                    std::uint64_t& room) {
  struct Candidate {
    std::uint64_t bytes;
    PatchChoice* choice;
    std::size_t patch;
  };
  PatchChoices choices;
  std::vector<Candidate> candidates;
  for (const SceneSurface& style : styles) {
    if (!style.shown || !is_boundary(style) || choices.contains(style.boundary)) continue;
    SPLATVOL_TRY_ASSIGN(patches, patches_of(volume, style.boundary));
    for (const std::size_t patch : patches) {
      const format::PatchInfo& info = volume.info().boundary->patches[patch];
      candidates.push_back({drawn_bytes(info.points, info.triangles), &choices[style.boundary], patch});
    }
  }
  std::ranges::stable_sort(candidates, {}, &Candidate::bytes);
  for (const auto& [bytes, choice, patch] : candidates) {
    if (bytes > room) {
      choice->left_out.push_back(volume.info().boundary->patches[patch].name);
      continue;
    }
    room -= bytes;
    choice->patches.push_back(patch);
  }
  for (auto& [pattern, choice] : choices) std::ranges::sort(choice.patches);
  return choices;
}

// Returns the surfaces of before whose triangles may be taken over: those that show the same patches, and those that
// are hidden now and still have room.
std::vector<Surface> reusable(std::span<const Surface> before, const PatchChoices& choices, std::uint64_t room) {
  std::vector<Surface> surfaces;
  std::ranges::copy_if(before, std::back_inserter(surfaces), [&](const Surface& surface) {
    if (!surface.mesh || !is_boundary(surface.style)) return true;
    if (const auto chosen = choices.find(surface.style.boundary); chosen != choices.end())
      return chosen->second.left_out == surface.left_out;
    const std::uint64_t bytes = drawn_bytes(surface.mesh->points.size(), surface.mesh->triangles.size());
    if (bytes > room) return false;
    room -= bytes;
    return true;
  });
  return surfaces;
}

// Reads the values of cells at the points of a mesh; at the middles of its triangles, if cells have one value each. A
// part of them at a time bounds the memory. `reach`: how far the points may be from cells.
Result<SurfaceValues> sample_at(const TriangleMesh& mesh, double reach, const format::Volume& volume,
                                const std::string& attribute) {
  constexpr std::uint64_t held_bytes = std::uint64_t{16} << 20;
  constexpr std::size_t at_once = std::size_t{1} << 18;
  SPLATVOL_TRY_ASSIGN(number, format::find_attribute(volume.info(), attribute, volume.name()));
  SPLATVOL_TRY_ASSIGN(cells, CellTetrahedra::open(volume, {static_cast<std::size_t>(number)}, own_room(held_bytes)));
  if (!cells)
    return fail(
        ErrorCode::invalid_argument,
        "{}: it keeps no cells, and only these have values for \"color_by\" of a surface: build it from a mesh, "
        "without --drop-cells",
        volume.name());
  SurfaceValues values{attribute, volume.name(), volume.step_key(), {}, cells->has_constant()};
  const std::size_t count = values.of_triangles ? mesh.triangles.size() : mesh.points.size();
  std::vector<dvec3> positions;
  for (std::size_t begin = 0; begin < count; begin += at_once) {
    positions.clear();
    for (std::size_t i = begin; i < std::min(count, begin + at_once); ++i)
      positions.push_back(values.of_triangles ? middle_of(mesh, i) : mesh.points[i]);
    SPLATVOL_TRY_ASSIGN(part, sample_cells(*cells, positions, reach));
    values.values.insert(values.values.end(), part.begin(), part.end());
  }
  return values;
}

}  // namespace

Result<std::vector<Surface>> read_scene_surfaces(std::span<const SceneSurface> styles, const format::Volume& volume,
                                                 const ReadSurface& read_file, std::uint64_t room,
                                                 std::span<const Surface> before) {
  SPLATVOL_TRY_ASSIGN(choices, choose_patches(styles, volume, room));
  const auto boundary = [&](const std::string& pattern) { return volume.read_boundary(choices[pattern].patches); };
  SPLATVOL_TRY_ASSIGN(surfaces, read_surfaces(styles, {read_file, boundary}, reusable(before, choices, room)));
  for (Surface& surface : surfaces)
    if (const auto chosen = choices.find(surface.style.boundary); chosen != choices.end())
      surface.left_out = chosen->second.left_out;
  SPLATVOL_TRY(add_values(surfaces, volume, before));
  return surfaces;
}

Status add_values(std::span<Surface> surfaces, const format::Volume& volume, std::span<const Surface> before) {
  for (Surface& surface : surfaces) {
    surface.values.reset();
    if (!surface.is_visible() || !surface.style.color_by) continue;
    const std::string& attribute = surface.style.color_by->attribute;
    const auto has_same = [&](const Surface& other) {
      return other.values && other.mesh == surface.mesh && other.values->attribute == attribute &&
             other.values->file == volume.name() && other.values->step_key == volume.step_key();
    };
    if (const auto same = std::ranges::find_if(before, has_same); same != before.end()) {
      surface.values = same->values;
      continue;
    }
    // A file rounds its boundary apart from its cells.
    const bool is_patch = is_boundary(surface.style) && volume.info().boundary;
    SPLATVOL_TRY_ASSIGN(values,
                        sample_at(*surface.mesh, is_patch ? volume.info().boundary->error : 0, volume, attribute));
    surface.values = std::make_shared<const SurfaceValues>(std::move(values));
  }
  return {};
}

// Points are there twice (draw_surfaces).
std::uint64_t drawn_bytes(std::uint64_t points, std::uint64_t triangles) {
  return 2 * sizeof(dvec3) * points + sizeof(std::array<std::uint32_t, 3>) * triangles +
         sizeof(double) * std::max(points, triangles);
}

std::uint64_t bytes_of_patches(const format::Volume& volume) {
  std::uint64_t bytes = 0;
  if (volume.info().boundary)
    for (const format::PatchInfo& patch : volume.info().boundary->patches)
      bytes += drawn_bytes(patch.points, patch.triangles);
  return bytes;
}

std::optional<Error> left_out_error(std::span<const Surface> surfaces, const std::string& file) {
  std::vector<std::string> names;
  for (const Surface& surface : surfaces)
    if (surface.style.shown)
      for (const std::string& name : surface.left_out)
        if (std::ranges::find(names, name) == names.end()) names.push_back(name);
  if (names.empty()) return std::nullopt;
  const std::size_t count = names.size();
  std::ranges::reverse(names);
  names.resize(std::min(count, most_names));
  return fail(ErrorCode::out_of_budget,
              "{}: the boundary is drawn without {} of its patches, {}{}: they need more than a quarter of the memory",
              file, count, fmt::join(names, ", "), count > most_names ? ", ..." : "")
      .value();
}

}  // namespace splatvol
