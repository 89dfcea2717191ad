// VTK's readers of files with blocks and time steps, behind one interface.
#pragma once

#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "builder/sources/data_sets.h"
#include "builder/sources/vtk/data_set.h"

class vtkAlgorithm;
class vtkMultiBlockDataSet;
class vtkMultiBlockDataSetAlgorithm;

namespace splatvol {

/// The differences between the formats. Call its functions inside run_vtk, in the order in which
/// they stand here.
class BlockReader {
 public:
  virtual ~BlockReader() = default;

  /// Checks a file and those that it names before open() sees them, as VTK's readers print, hang or end the program if
  /// a file is damaged. Not inside run_vtk. Safe on untrusted bytes.
  virtual Status check(const std::string& /*path*/, const SourceOptions& /*options*/) { return {}; }

  /// Opens a file. Returns VTK's reader; null if it has no pipeline: then there are times() and output().
  virtual vtkMultiBlockDataSetAlgorithm* open(const std::string& path) = 0;

  /// The blocks that were read last, without a pipeline.
  virtual vtkMultiBlockDataSet* output() { return nullptr; }

  /// Chooses arrays and blocks, after the file's header has been read.
  virtual void select(const std::vector<std::string>& selection) = 0;

  /// Fails if the file declares more time steps than were found.
  [[nodiscard]] virtual Status check_steps(std::size_t /*found*/) const { return {}; }

  /// Counts what check() and read() have changed since the last call.
  virtual CellCensus take_changes() { return {}; }

  /// Lets read() bring the patches along too, as surfaces. Called before select().
  virtual void want_patches() {}

  /// The name of the patch that a surface is; `path`: the names of the blocks that it lies in, and its own. Empty: the
  /// surface is none.
  [[nodiscard]] virtual std::string patch_name(const std::vector<std::string>& path) const { return path.back(); }

  /// The word for such a block.
  [[nodiscard]] virtual std::string block_word() const { return "block"; }

  /// The name of the block that a data set is, or is a part of: the same in each file, step and portion that has a part
  /// of it. `path`: as for patch_name().
  [[nodiscard]] virtual std::string block_name(const std::vector<std::string>& path) const;

  /// As DataSets::declared(), for a data set of the output.
  [[nodiscard]] virtual DeclaredArrays declared(vtkDataSet& /*data*/) { return {}; }

  /// Returns patches that are no surfaces of the output, once.
  virtual std::vector<Patch> take_patches() { return {}; }

  /// All arrays of a file that has several portions, at a time, before any of them is read. Other readers may return
  /// none.
  virtual std::vector<ArrayShape> arrays(std::optional<double> /*time*/) { return {}; }

  /// The times of the steps, if it is not VTK's reader that finds them.
  virtual std::vector<double> times() const { return {}; }

  /// Whether read() rounds points to single precision, though the file may have more digits.
  virtual bool rounds_points() const { return false; }

  /// Whether the file has more digits. Reads its points.
  virtual bool has_finer_points(std::optional<double> /*time*/) { return false; }

  /// As DataSets::notes().
  [[nodiscard]] virtual std::set<std::string> notes() const { return {}; }

  /// As DataSets::left_out_arrays().
  [[nodiscard]] virtual std::set<std::string> left_out_arrays() const { return {}; }

  /// Number of portions. A portion is read at once: a block, or the whole file.
  virtual int portions() { return 1; }

  /// Reads a portion into the reader's output, at a time, or without one if the file has no time steps.
  virtual void read(int portion, std::optional<double> time) = 0;
};

/// Lets VTK's reader read one of `pieces` pieces, at a time if there is one.
void update(vtkAlgorithm& reader, std::optional<double> time, int piece, int pieces);

/// Opens a file of several blocks and time steps. Every block with points is a data set, except surfaces: blocks that
/// have cells with an area, and none with a volume. Each portion is read by the next() that returns its first block.
/// Fails if the file cannot be read.
[[nodiscard]] Result<std::unique_ptr<DataSets>> open_blocks(const InputFile& file, const SourceOptions& options,
                                                            std::unique_ptr<BlockReader> reader);

}  // namespace splatvol
