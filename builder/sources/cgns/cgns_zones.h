// Reads the solutions of CGNS files, and the zones in which VTK's reader takes other elements for the cells.
#pragma once

#include <vtkDataArray.h>
#include <vtkSmartPointer.h>

#include <cstddef>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "builder/sources/vtk/data_set.h"

class vtkMultiBlockDataSet;

namespace splatvol {

/// Merges scalars whose names end in X, Y and Z, or in _x, _y and _z, into one array. Like VTK's reader, it does not if
/// another field has the name of this array. Requires sorted names.
[[nodiscard]] std::vector<ArrayShape> merge_cgns_vectors(const std::vector<std::string>& names);

/// A solution with values of points or of cells.
struct CgnsSolution {
  int number;  // in its zone, by the library
  std::string name;
  bool of_cells;
  std::string label;  // in the names of arrays: the same at all times
};

/// An array that solutions give: one field, or three that are a vector.
struct CgnsArray {
  CgnsSolution solution;
  std::string field;  // of a vector: without the ends of its components' names
  ArrayShape shape;   // its name tells the solution, too, if another one of the zone has such a field
};

/// Arrays of a zone, and whether each is one of cells.
using CgnsValues = std::vector<std::pair<bool, vtkSmartPointer<vtkDataArray>>>;

/// A file. Its functions throw ReaderErrors. Zones count from 0 over all bases. Not thread-safe.
class CgnsZones {
 public:
  /// Throws if a zone has other coordinates than those along x, y and z.
  explicit CgnsZones(const std::string& path);
  ~CgnsZones();
  CgnsZones(const CgnsZones&) = delete;
  CgnsZones& operator=(const CgnsZones&) = delete;

  /// Whether read() is to be taken for the meshes: it can read all of them, or VTK's reader would fail for one. That
  /// one takes the elements with the lowest numbers for the cells, so surfaces must have higher ones. It takes cells of
  /// a file of CGNS 3.0 for others.
  [[nodiscard]] bool reads_meshes();

  /// Closes the file that one of these has open, until it is needed again. To be called before others open a file:
  /// where it is the same one, the library takes one for the other when it closes it.
  static void close_file();

  [[nodiscard]] int count() const { return static_cast<int>(zones_.size()); }
  /// Those of all bases, sorted.
  [[nodiscard]] const std::vector<double>& times() const { return times_; }
  [[nodiscard]] const std::string& name_of(int zone) const { return zones_[static_cast<std::size_t>(zone)].name; }

  /// Whether a zone belongs to a time: BaseIterativeData may name the zones of each.
  [[nodiscard]] bool is_there(int zone, std::optional<double> time) const;

  /// Lists the arrays of all zones at a time, and those of a zone at the time of the last call. If several solutions of
  /// a zone have a field of one name, the last one's keeps the name; the others' get that of their solution behind it.
  [[nodiscard]] std::vector<ArrayShape> arrays(std::optional<double> time);
  [[nodiscard]] std::vector<ArrayShape> arrays_of(int zone) const;

  /// Lines on solutions that are not as they should be, at the time of the last call of arrays().
  [[nodiscard]] const std::set<std::string>& losses() const { return losses_; }

  /// Reads a zone into a tree of its base and itself, without arrays: cells with a volume, or surfaces if it has no
  /// others.
  void read(int zone, std::optional<double> time, vtkMultiBlockDataSet& tree);

  /// Reads the arrays of a zone. Where a solution has values of some points or cells only, those at the others are
  /// missing.
  [[nodiscard]] CgnsValues read_arrays(int zone, std::optional<double> time, const std::vector<std::string>& selection);

 private:
  struct Zone {
    int base, zone;
    std::string name;
    std::vector<double> times;        // of the steps of its base
    std::set<std::size_t> not_at;     // steps that it does not belong to
    std::vector<CgnsArray> arrays{};  // at arrays_at_
  };
  [[nodiscard]] static std::optional<std::size_t> step_of(const Zone& zone, std::optional<double> time);
  [[nodiscard]] int file();
  void find_arrays(std::optional<double> time);

  std::string path_;
  int file_ = 0;  // while open_ is this
  inline static CgnsZones* open_ = nullptr;
  std::vector<Zone> zones_;
  std::vector<double> times_;
  bool has_arrays_ = false;
  std::optional<double> arrays_at_;
  std::set<std::string> losses_;
};

}  // namespace splatvol
