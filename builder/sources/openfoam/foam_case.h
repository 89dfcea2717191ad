// The folders of an OpenFOAM case: its processors, regions and time steps.
#pragma once

#include <cstddef>
#include <functional>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "builder/sources/openfoam/foam_fields.h"
#include "builder/sources/openfoam/foam_mesh.h"

namespace splatvol {

struct FoamFieldFile {
  std::string name;
  FoamFieldKind kind;
  FoamPlace place;
};

/// A case, of which only folders have been read. It is in parts if it is read from its processors: if it has no mesh
/// itself, or lacks their last time step. All functions throw a ReaderError. Safe on untrusted files.
class FoamCase {
 public:
  /// `path`: system/controlDict, or a file in the case's folder. Throws if a processor's folder is missing.
  explicit FoamCase(const std::string& path);

  /// Number of processors; 0: the case is whole.
  [[nodiscard]] std::size_t processor_count() const { return is_whole_ ? 0 : parts_.size(); }

  /// The times of all steps, ascending.
  [[nodiscard]] const std::vector<double>& times() const { return times_; }

  /// The regions that have a mesh: the one without a name first, the others by their names. If the case has a file
  /// regionProperties, the one without a name is what the others were made of: it is left out.
  [[nodiscard]] const std::vector<std::string>& regions() const { return regions_; }

  /// Fails if a part is missing: if the patches of the others name a processor that is not there, or if it lacks the
  /// time step or the mesh of a region that others have. `time`: of a step; none if there are no steps.
  void check_parts(std::optional<double> time) const;

  /// The place of a file of a region's mesh at a time. Throws if it is missing. Requires a part and a region.
  [[nodiscard]] FoamPlace mesh_file(std::size_t part, const std::string& region, std::optional<double> time,
                                    const std::string& name) const;

  using Wants = std::function<bool(const std::string&)>;

  /// The fields of a region at a time, by their names, whose names `wants` accepts. Throws if a file is empty, begins
  /// with zeros, or is cut off within its header. `left_out` receives a line for each other file, if it is not null.
  [[nodiscard]] std::vector<FoamFieldFile> fields(std::size_t part, const std::string& region,
                                                  std::optional<double> time, const Wants& wants,
                                                  std::set<std::string>* left_out = nullptr) const;

  /// A line for each file that lies beside the fields and meshes of all regions, if `wants` accepts its name: fields of
  /// regions without a mesh, zones and sets, and time steps that lead nowhere.
  [[nodiscard]] std::set<std::string> left_out(std::size_t part, std::optional<double> time, const Wants& wants) const;

 private:
  /// A folder with time steps: the case's, or that of some processors.
  struct Folder {
    std::string name;                     // in the case's folder; empty: this folder itself
    std::map<double, std::string> steps;  // names of folders
  };
  struct Part {
    std::size_t folder = 0;
    std::optional<std::size_t> block = {};  // of a folder of several processors
  };

  void find_processors();
  void add_collated(const std::vector<std::string>& names);
  void add_folder(const std::string& name);
  void find_regions();
  void tell_homeless_fields(const Part& part, const std::string& step, const Wants& wants,
                            std::set<std::string>& left_out) const;
  void tell_groups(const Part& part, const std::string& mesh, const Wants& wants,
                   std::set<std::string>& left_out) const;
  [[nodiscard]] std::string path_of(const std::string& name) const;
  [[nodiscard]] FoamPlace place_of(const Part& part, const std::string& name) const;
  [[nodiscard]] std::string find_file(const Folder& folder, const std::string& name) const;
  [[nodiscard]] std::string mesh_folder(const Folder& folder, const std::string& region, std::optional<double> time,
                                        const std::string& name) const;

  std::string folder_;
  std::vector<Folder> folders_;
  std::vector<Part> parts_;
  bool is_whole_ = true;
  std::vector<double> times_;
  std::vector<std::string> regions_;
};

}  // namespace splatvol
