// Reads the zones of CGNS files in which VTK's reader takes other elements for the cells.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "builder/sources/vtk/attributes.h"

class vtkMultiBlockDataSet;

namespace splatvol {

/// Merges scalars whose names end in X, Y and Z, or in _x, _y and _z, into one array. Like VTK's reader, it does not if
/// another field has the name of this array. Requires sorted names.
[[nodiscard]] std::vector<ArrayShape> merge_cgns_vectors(const std::vector<std::string>& names);

/// An open file. Its functions throw ReaderErrors. Not thread-safe.
class CgnsZones {
 public:
  explicit CgnsZones(const std::string& path);
  ~CgnsZones();
  CgnsZones(const CgnsZones&) = delete;
  CgnsZones& operator=(const CgnsZones&) = delete;

  /// Whether VTK's reader fails for a zone. It takes the elements with the lowest numbers for the cells, so surfaces
  /// must have higher ones. It finds no values in a flat zone. It takes cells of a file of CGNS 3.0 for others.
  [[nodiscard]] bool defeats_vtk() const;

  [[nodiscard]] int count() const { return static_cast<int>(zones_.size()); }
  [[nodiscard]] const std::vector<double>& times() const { return times_; }

  /// Reads a zone into a tree of its base and itself: cells with a volume, or surfaces if it has no others; a flat zone
  /// without its values. `step`: of times(), if there are any.
  void read(int zone, std::optional<std::size_t> step, const std::vector<std::string>& selection,
            vtkMultiBlockDataSet& tree) const;

 private:
  struct Zone {
    int base, zone;
  };
  std::string path_;
  int file_ = 0;
  std::vector<Zone> zones_;
  std::vector<double> times_;
};

}  // namespace splatvol
