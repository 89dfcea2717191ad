// OpenFOAM cases that are decomposed into a folder for each processor.
#pragma once

#include <vtkOpenFOAMReader.h>

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "builder/sources/array_union.h"

namespace splatvol {

/// VTK's reader of a case, or of one processor's part of it.
class ProcessorReader final : public vtkOpenFOAMReader {
 public:
  static ProcessorReader* New();
  vtkTypeMacro(ProcessorReader, vtkOpenFOAMReader) ProcessorReader(const ProcessorReader&) = delete;
  void operator=(const ProcessorReader&) = delete;

  /// Reads the folder of a processor from the next update on, and forgets the mesh of the last one. Empty: reads the
  /// case itself.
  void set_processor(const std::string& folder);

 protected:
  ProcessorReader() = default;
  ~ProcessorReader() override = default;
  int RequestInformation(vtkInformation* request, vtkInformationVector** inputs,
                         vtkInformationVector* outputs) override;

 private:
  std::string folder_;
  bool is_new_ = false;
};

/// Lists the folders of a case's processors, in order. Lists none if the case itself has a mesh, and has the last of
/// their time steps: such a case is read from its own folder. `path`: system/controlDict, or a
/// file in the case's folder. Throws if the folder of a processor is missing, or if the folders are collated.
[[nodiscard]] std::vector<std::string> find_processors(const std::string& path);

/// Throws if the reader's folder has no such time step. Requires that its information is up to date.
void check_openfoam_time(ProcessorReader& reader, std::optional<double> time);

/// Whether single precision, in which VTK's reader gives points, does not keep those of the case. `path` and
/// `processors` as find_processors() takes and returns them. Looks at the first 16 MiB of each file of points.
[[nodiscard]] bool has_finer_openfoam_points(const std::string& path, const std::vector<std::string>& processors);

/// Cuts the units off the names of all arrays that the reader has read, and adds them to `units`, by name.
void take_openfoam_units(ProcessorReader& reader, std::map<std::string, std::string>& units);

/// Lists the fields of a case's volume meshes at a time, by the headers of their files: those of all regions, and of
/// the folders in `processors`; none: the case itself. Compressed files are left out.
[[nodiscard]] std::vector<ArrayShape> openfoam_arrays(const std::string& path,
                                                      const std::vector<std::string>& processors, double time);

}  // namespace splatvol
