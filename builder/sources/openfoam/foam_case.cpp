#include "builder/sources/openfoam/foam_case.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <iterator>
#include <set>
#include <string_view>
#include <system_error>

#include "builder/sources/read_text.h"

namespace splatvol {
namespace {

namespace fs = std::filesystem;

struct Entries {
  std::vector<std::string> folders, files;
};

/// The names in a folder, sorted. None if it cannot be read.
Entries entries_of(const std::string& path) {
  Entries entries;
  std::error_code error, ignored;
  for (fs::directory_iterator entry(path, error), end; !error && entry != end; entry.increment(error))
    if (entry->is_directory(ignored))
      entries.folders.push_back(entry->path().filename());
    else if (entry->is_regular_file(ignored))
      entries.files.push_back(entry->path().filename());
  std::ranges::sort(entries.folders);
  std::ranges::sort(entries.files);
  return entries;
}

std::optional<double> time_of(const std::string& name) {
  const auto time = number_of<double>(name);
  return time && std::isfinite(*time) ? time : std::nullopt;
}

/// The time steps in a folder. Of several names of one time, the shortest.
std::map<double, std::string> steps_in(const std::string& path) {
  std::map<double, std::string> steps;
  for (const std::string& name : entries_of(path).folders)
    if (const auto time = time_of(name)) {
      std::string& known = steps[*time];
      if (known.empty() || name.size() < known.size()) known = name;
    }
  return steps;
}

bool exists(const std::string& path) {
  std::error_code error;
  return fs::exists(path, error);
}

/// Whether a folder of a mesh holds one, or a part of it. Some hold settings only.
bool has_mesh_files(const std::string& path) {
  return std::ranges::any_of(std::array{"points", "faces", "owner"}, [&](const char* name) {
    return exists(fmt::format("{}/polyMesh/{}", path, name)) || exists(fmt::format("{}/polyMesh/{}.gz", path, name));
  });
}

/// The regions with a mesh in a folder of a time step, or in "constant".
void add_regions(const std::string& path, std::set<std::string>& regions) {
  if (has_mesh_files(path)) regions.insert("");
  for (const std::string& name : entries_of(path).folders)
    if (name != "polyMesh" && has_mesh_files(fmt::format("{}/{}", path, name))) regions.insert(name);
}

std::set<std::string> regions_in(const std::string& path) {
  std::set<std::string> regions;
  add_regions(path + "/constant", regions);
  for (const auto& [time, name] : steps_in(path)) add_regions(fmt::format("{}/{}", path, name), regions);
  return regions;
}

std::optional<double> last_time(const std::string& path) {
  const std::map<double, std::string> steps = steps_in(path);
  return steps.empty() ? std::nullopt : std::optional(steps.rbegin()->first);
}

/// Whether the case itself holds all that its processors hold. `processors`: a folder of some of them.
bool is_reconstructed(const std::string& path, const std::string& processors) {
  const auto own = last_time(path), of_processors = last_time(processors);
  return !regions_in(path).empty() && (!of_processors || (own && *own >= *of_processors));
}

/// The numbers of a folder such as "processors4" or "processors4_0-1", which holds two of four.
struct Collated {
  std::size_t count = 0, first = 0, last = 0;
};

std::optional<Collated> collated_of(std::string_view name) {
  constexpr std::string_view start = "processors";
  if (!name.starts_with(start)) return std::nullopt;
  name.remove_prefix(start.size());
  const std::size_t cut = std::min(name.find('_'), name.size());
  const auto count = number_of<std::size_t>(name.substr(0, cut));
  if (!count || *count == 0) return std::nullopt;
  if (cut == name.size()) return Collated{*count, 0, *count - 1};
  const std::string_view range = name.substr(cut + 1);
  const std::size_t dash = std::min(range.find('-'), range.size());
  const auto first = number_of<std::size_t>(range.substr(0, dash));
  const auto last = dash < range.size() ? number_of<std::size_t>(range.substr(dash + 1)) : std::nullopt;
  if (!first || !last || *first > *last || *last >= *count) return std::nullopt;
  return Collated{*count, *first, *last};
}

std::optional<std::size_t> processor_of(std::string_view name) {
  constexpr std::string_view start = "processor";
  return name.starts_with(start) ? number_of<std::size_t>(name.substr(start.size())) : std::nullopt;
}

/// Whether a file of a time step is one that an editor or a user has put aside.
bool is_put_aside(std::string_view name) {
  return name.starts_with('.') || name.ends_with('~') ||
         std::ranges::any_of(std::array<std::string_view, 5>{".bak", ".BAK", ".old", ".orig", ".save"},
                             [&](std::string_view end) { return name.ends_with(end); });
}

}  // namespace

FoamCase::FoamCase(const std::string& path) {
  fs::path folder = fs::path(path).parent_path();
  if (path.ends_with("system/controlDict")) folder = folder.parent_path();
  folder_ = folder.empty() ? "." : folder.string();
  find_processors();
  if (is_whole_) {
    add_folder("");
    parts_ = {Part{}};
  }
  std::set<double> times;
  for (const Folder& each : folders_)
    for (const auto& [time, name] : each.steps) times.insert(time);
  times_.assign(times.begin(), times.end());
  find_regions();
}

void FoamCase::find_processors() {
  std::map<std::size_t, std::string> processors;
  std::vector<std::string> collated;
  for (const std::string& name : entries_of(folder_).folders) {
    if (const auto number = processor_of(name)) processors.emplace(*number, name);
    if (collated_of(name)) collated.push_back(name);
  }
  if (processors.empty() && collated.empty()) return;
  const std::string any = processors.empty() ? collated.front() : processors.begin()->second;
  if (is_reconstructed(folder_, path_of(any))) return;
  is_whole_ = false;
  if (processors.empty()) return add_collated(collated);
  for (std::size_t i = 0; i < processors.size(); ++i) {
    if (!processors.contains(i)) throw ReaderError("the folder processor{} of the decomposed case is missing", i);
    parts_.push_back({folders_.size()});
    add_folder(processors.at(i));
  }
}

void FoamCase::add_collated(const std::vector<std::string>& names) {
  std::map<std::size_t, std::string> by_first;
  const std::size_t count = collated_of(names.front())->count;
  for (const std::string& name : names) {
    const Collated part = *collated_of(name);
    if (part.count != count || !by_first.emplace(part.first, name).second)
      throw ReaderError("the folders {} and {} are of different decompositions: remove one", names.front(), name);
  }
  for (const auto& [first, name] : by_first) {
    const Collated part = *collated_of(name);
    if (part.first != parts_.size()) break;
    for (std::size_t i = part.first; i <= part.last; ++i) parts_.push_back({folders_.size(), i - part.first});
    add_folder(name);
  }
  if (parts_.size() != count) throw ReaderError("the folder of processor {} of {} is missing", parts_.size(), count);
}

void FoamCase::add_folder(const std::string& name) { folders_.push_back({name, steps_in(path_of(name))}); }

void FoamCase::find_regions() {
  std::set<std::string> regions;
  for (const Folder& folder : folders_) regions.merge(regions_in(path_of(folder.name)));
  // splitMeshRegions leaves the mesh that it has split where it was. Solvers of several regions never read it.
  if (regions.size() > 1 && exists(path_of("constant/regionProperties"))) regions.erase("");
  regions_.assign(regions.begin(), regions.end());
  if (regions_.empty())
    throw ReaderError("the case has no mesh (constant/polyMesh): make it first, with blockMesh for one");
}

std::string FoamCase::path_of(const std::string& name) const { return name.empty() ? folder_ : folder_ + "/" + name; }

FoamPlace FoamCase::place_of(const Part& part, const std::string& name) const {
  FoamPlace place{path_of(name), name, folder_, part.block};
  if (part.block) place.name += fmt::format(" (block {})", *part.block);
  return place;
}

/// The name of a file, or of the packed one; empty: there is neither.
std::string FoamCase::find_file(const Folder& folder, const std::string& name) const {
  const std::string file = folder.name.empty() ? name : folder.name + "/" + name;
  for (const char* end : {"", ".gz"})
    if (exists(path_of(file + end))) return file + end;
  return {};
}

/// The last step, up to a time, that has a file of this name of a region's mesh. None has it: "constant".
std::string FoamCase::mesh_folder(const Folder& folder, const std::string& region, std::optional<double> time,
                                  const std::string& name) const {
  const std::string inner = (region.empty() ? "" : region + "/") + "polyMesh/" + name;
  auto step = time ? folder.steps.upper_bound(*time) : folder.steps.begin();
  while (step != folder.steps.begin()) {
    --step;
    if (!find_file(folder, step->second + "/" + inner).empty()) return step->second;
  }
  return "constant";
}

FoamPlace FoamCase::mesh_file(std::size_t part, const std::string& region, std::optional<double> time,
                              const std::string& name) const {
  const Folder& folder = folders_[parts_[part].folder];
  // A mesh that moves has new points only. All else is where the faces are.
  const std::string of = mesh_folder(folder, region, time, name == "points" ? "points" : "faces") +
                         (region.empty() ? "" : "/" + region) + "/polyMesh/" + name;
  const std::string file = find_file(folder, of);
  if (!file.empty()) return place_of(parts_[part], file);
  throw ReaderError("{}{}{}: the file is missing", folder.name, folder.name.empty() ? "" : "/", of);
}

void FoamCase::check_parts(std::optional<double> time) const {
  for (const Folder& folder : folders_)
    if (time && !folder.steps.contains(*time))
      throw ReaderError("{} has no time step {}, which others have", folder.name, *time);
  for (std::size_t part = 0; part < parts_.size() && !is_whole_; ++part)
    for (const std::string& region : regions_) {
      const FoamPlace boundary = mesh_file(part, region, time, "boundary");
      for (const FoamPatch& patch : read_foam_patches(boundary))
        if (patch.neighbour_processor.value_or(0) >= parts_.size())
          throw ReaderError("processor{} of the decomposed case is missing: {} names it", *patch.neighbour_processor,
                            boundary.name);
    }
}

std::vector<FoamFieldFile> FoamCase::fields(std::size_t part, const std::string& region, std::optional<double> time,
                                            const std::function<bool(const std::string&)>& wants) const {
  std::vector<FoamFieldFile> fields;
  const Folder& folder = folders_[parts_[part].folder];
  const auto step = time ? folder.steps.find(*time) : folder.steps.end();
  if (step == folder.steps.end()) return fields;
  std::string inner = folder.name.empty() ? step->second : folder.name + "/" + step->second;
  if (!region.empty()) inner += "/" + region;
  for (const std::string& file : entries_of(path_of(inner)).files) {
    std::string name = file;
    if (name.ends_with(".gz")) name.resize(name.size() - 3);
    if (is_put_aside(name) || !wants(name) || (!fields.empty() && fields.back().name == name)) continue;
    const FoamPlace place = place_of(parts_[part], fmt::format("{}/{}", inner, file));
    if (!has_foam_header(place)) continue;
    if (const auto kind = foam_field_kind(FoamReader(place).class_name())) fields.push_back({name, *kind, place});
  }
  return fields;
}

}  // namespace splatvol
