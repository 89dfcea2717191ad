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
#include <utility>

#include "builder/sources/read_text.h"

namespace splatvol {
namespace {

namespace fs = std::filesystem;

struct Entries {
  std::vector<std::string> folders, files;
  std::vector<std::pair<std::string, const char*>> others;  // names, and why they cannot be read
};

/// A name in a folder. Either may be empty.
std::string joined(const std::string& folder, const std::string& name) {
  return folder + (folder.empty() || name.empty() ? "" : "/") + name;
}

bool leads_nowhere(const fs::path& path) {
  std::error_code ignored;
  return fs::is_symlink(fs::symlink_status(path, ignored)) && !fs::exists(path, ignored);
}

/// The names in a folder, sorted. None if there is no such folder. Throws if it cannot be read.
Entries entries_of(const std::string& path) {
  Entries entries;
  std::error_code error, ignored;
  for (fs::directory_iterator entry(path, error), end; !error && entry != end; entry.increment(error))
    if (entry->is_directory(ignored))
      entries.folders.push_back(entry->path().filename());
    else if (entry->is_regular_file(ignored))
      entries.files.push_back(entry->path().filename());
    else
      entries.others.emplace_back(entry->path().filename(),
                                  leads_nowhere(entry->path()) ? "a link that leads nowhere" : "not a regular file");
  if (error && error != std::errc::no_such_file_or_directory && error != std::errc::not_a_directory)
    throw ReaderError("{}: the folder cannot be read: {}", path, error.message());
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

/// Whether there is a file. A link that leads nowhere is one: reading it fails, where passing over it would take an
/// older file of the same name.
bool exists(const std::string& path) {
  std::error_code error;
  return fs::exists(fs::symlink_status(path, error));
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

/// Whether a class is one of fields that have values neither of cells nor of points: of faces, of surfaces in the mesh,
/// or one value in all.
bool is_of_others(std::string_view class_name) {
  return class_name.find("Field") != std::string_view::npos &&
         std::ranges::any_of(std::array<std::string_view, 4>{"surface", "area", "edge", "uniformDimensioned"},
                             [&](std::string_view start) { return class_name.starts_with(start); });
}

/// The name of a field, which a packed file has without its ".gz".
std::string without_gz(std::string name) {
  if (name.ends_with(".gz")) name.resize(name.size() - 3);
  return name;
}

/// Whether a file of a time step is one whose field is asked for.
bool is_wanted(const std::string& file, const FoamCase::Wants& wants) {
  const std::string name = without_gz(file);
  return !is_put_aside(name) && wants(name);
}

/// Whether a file is a field of cells or points. Not if it is damaged.
bool is_field(const FoamPlace& place) {
  try {
    return has_foam_header(place) && foam_field_kind(FoamReader(place).class_name());
  } catch (const ReaderError&) {
    return false;
  }
}

/// The names of the zones in a file: as many as can be read.
std::string zones_of(const FoamPlace& place) {
  FoamReader reader(place);
  std::string names;
  while (!reader.peek().is('(')) {
    if (reader.peek().kind == FoamToken::Kind::end) return names;
    reader.next();
  }
  reader.expect('(');
  while (!reader.peek().is(')')) {
    names += (names.empty() ? "" : ", ") + reader.next().text;
    reader.expect('{');
    if (!reader.skip_block()) return names + ", ...";
  }
  return names;
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

std::string FoamCase::path_of(const std::string& name) const { return joined(folder_, name); }

FoamPlace FoamCase::place_of(const Part& part, const std::string& name) const {
  FoamPlace place{path_of(name), name, folder_, part.block};
  if (part.block) place.name += fmt::format(" (block {})", *part.block);
  return place;
}

/// The name of a file, or of the packed one; empty: there is neither.
std::string FoamCase::find_file(const Folder& folder, const std::string& name) const {
  const std::string file = joined(folder.name, name);
  for (const char* end : {"", ".gz"})
    if (exists(path_of(file + end))) return file + end;
  return {};
}

/// The last step, up to a time, that has a file of this name of a region's mesh. None has it: "constant".
std::string FoamCase::mesh_folder(const Folder& folder, const std::string& region, std::optional<double> time,
                                  const std::string& name) const {
  auto step = time ? folder.steps.upper_bound(*time) : folder.steps.begin();
  while (step != folder.steps.begin()) {
    --step;
    const std::string mesh = joined(joined(step->second, region), "polyMesh");
    if (const std::string place = joined(folder.name, mesh); leads_nowhere(path_of(place)))
      throw ReaderError("{}: a link that leads nowhere", place);
    if (!find_file(folder, joined(mesh, name)).empty()) return step->second;
  }
  return "constant";
}

FoamPlace FoamCase::mesh_file(std::size_t part, const std::string& region, std::optional<double> time,
                              const std::string& name) const {
  const Folder& folder = folders_[parts_[part].folder];
  // A mesh that moves has new points only. All else is where the faces are.
  const std::string mesh = mesh_folder(folder, region, time, name == "points" ? "points" : "faces");
  const std::string of = joined(joined(joined(mesh, region), "polyMesh"), name);
  const std::string file = find_file(folder, of);
  if (!file.empty()) return place_of(parts_[part], file);
  throw ReaderError("{}: the file is missing", joined(folder.name, of));
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
                                            const Wants& wants, std::set<std::string>* left_out) const {
  std::vector<FoamFieldFile> fields;
  const Folder& folder = folders_[parts_[part].folder];
  const auto step = time ? folder.steps.find(*time) : folder.steps.end();
  if (step == folder.steps.end()) return fields;
  const std::string inner = joined(joined(folder.name, step->second), region);
  const auto tell = [&](const std::string& file, const std::string& why) {
    if (left_out) left_out->insert(fmt::format("{}: left out: {}", file, why));
  };
  const Entries entries = entries_of(path_of(inner));
  for (const auto& [file, fault] : entries.others)
    if (is_wanted(file, wants)) tell(joined(inner, file), fault);
  if (std::ranges::find(entries.folders, "lagrangian") != entries.folders.end() && wants("lagrangian"))
    tell("lagrangian", "particles");
  for (const std::string& file : entries.files) {
    const std::string name = without_gz(file);
    if (!is_wanted(file, wants)) continue;
    if (file != name && std::ranges::find(entries.files, name) != entries.files.end()) {
      tell(joined(inner, file), fmt::format("there is a file {}, too", name));
      continue;
    }
    const FoamPlace place = place_of(parts_[part], joined(inner, file));
    if (!has_foam_header(place)) {
      tell(place.name, "it has no header (FoamFile) to tell whether it is a field");
      continue;
    }
    const std::string class_name = FoamReader(place).class_name();
    if (const auto kind = foam_field_kind(class_name))
      fields.push_back({name, *kind, place});
    else if (is_of_others(class_name))  // in all processors
      tell(name, fmt::format("{}, values of neither cells nor points", class_name));
    else if (class_name != "dictionary")
      tell(place.name, fmt::format("its class \"{}\" is not known", class_name));
  }
  return fields;
}

std::set<std::string> FoamCase::left_out(std::size_t part, std::optional<double> time, const Wants& wants) const {
  std::set<std::string> lines;
  const Folder& folder = folders_[parts_[part].folder];
  for (const auto& [name, fault] : entries_of(path_of(folder.name)).others)
    if (time_of(name)) lines.insert(fmt::format("{}: a time step, left out: {}", joined(folder.name, name), fault));
  const auto step = time ? folder.steps.find(*time) : folder.steps.end();
  if (step != folder.steps.end()) tell_homeless_fields(parts_[part], step->second, wants, lines);
  for (const std::string& region : regions_)
    tell_groups(parts_[part], joined(joined(mesh_folder(folder, region, time, "faces"), region), "polyMesh"), wants,
                lines);
  return lines;
}

/// Names the fields of a step that lie in the folder of no region with a mesh.
void FoamCase::tell_homeless_fields(const Part& part, const std::string& step, const Wants& wants,
                                    std::set<std::string>& left_out) const {
  const std::string inner = joined(folders_[part.folder].name, step);
  const auto has_mesh = [&](const std::string& region) {
    return std::ranges::find(regions_, region) != regions_.end();
  };
  const Entries entries = entries_of(path_of(inner));
  for (const auto& [file, fault] : entries.others)
    if (!has_mesh("") && is_wanted(file, wants))
      left_out.insert(fmt::format("{}: left out: {}", joined(inner, file), fault));
  std::vector<std::string> regions = entries.folders;
  regions.emplace_back();
  for (const std::string& region : regions) {
    if (has_mesh(region)) continue;
    for (const std::string& file : entries_of(path_of(joined(inner, region))).files) {
      const FoamPlace place = place_of(part, joined(joined(inner, region), file));
      if (is_wanted(file, wants) && is_field(place))
        left_out.insert(fmt::format("{}: left out: its region has no mesh", place.name));
    }
  }
}

/// Names the zones and sets of a mesh, by its folder.
void FoamCase::tell_groups(const Part& part, const std::string& mesh, const Wants& wants,
                           std::set<std::string>& left_out) const {
  const Folder& folder = folders_[part.folder];
  const auto tell = [&](const std::string& name, const std::function<std::string(const FoamPlace&)>& words_of) {
    const std::string file = wants(name) ? find_file(folder, joined(mesh, name)) : "";
    if (file.empty()) return;
    const FoamPlace place = place_of(part, file);
    try {
      if (!has_foam_header(place)) throw ReaderError("{}: it has no header (FoamFile)", place.name);
      const std::string words = words_of(place);
      if (!words.empty()) left_out.insert(fmt::format("{}: left out, as all zones and sets", words));
    } catch (const ReaderError& error) {
      left_out.insert(fmt::format("{}; left out", error.what()));
    }
  };
  for (const std::string name : {"cellZones", "faceZones", "pointZones"})
    tell(name, [&](const FoamPlace& place) {
      const std::string zones = zones_of(place);
      return zones.empty() ? zones : fmt::format("{} ({})", name, zones);
    });
  const Entries sets = entries_of(path_of(joined(joined(folder.name, mesh), "sets")));
  std::set<std::string> names;
  for (const std::string& file : sets.files) names.insert("sets/" + without_gz(file));
  for (const auto& [file, fault] : sets.others) names.insert("sets/" + without_gz(file));
  for (const std::string& name : names)
    if (!is_put_aside(name)) tell(name, [&](const FoamPlace&) { return name; });
}

}  // namespace splatvol
