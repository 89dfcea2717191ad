// The data sets of an input, one after the other, and how its files are read.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "base/error.h"
#include "builder/sources/array_union.h"
#include "builder/sources/data_set.h"
#include "builder/sources/source.h"

namespace splatvol {

class DataSets;
struct InputFile;
using ArraysOfParts = std::vector<std::vector<ArrayShape>>;

/// The reader of a format.
struct FileReader {
  /// Opens a file: some at the time step nearest to `options.time`, or without one at the last.
  Result<std::unique_ptr<DataSets>> (*open)(const InputFile& file, const SourceOptions& options) = nullptr;

  /// Lists the arrays of each part of a file by its headers. Null: an open file announces them.
  Result<ArraysOfParts> (*list_arrays)(const InputFile& file) = nullptr;
};

/// A file with data sets.
struct InputFile {
  std::string path;
  FileReader reader;
  std::vector<InputFile> blocks = {};  // of a composite file: what it names
  std::string values = {};             // a file with them: of SU2, which may have none, and of PLOT3D
  bool patches = false;                // DataSets::take_patches() is wanted
  bool is_block = false;               // of a composite file: surfaces are left out
  std::uint64_t block = 0;             // of a composite file: as Piece::block

  /// Whether it only names its blocks.
  [[nodiscard]] bool is_composite() const { return !reader.open; }
};

/// The arrays that a file declares for a part of it. An array that may be empty in its part counts as declared only
/// where the file has values of it.
struct DeclaredArrays {
  std::string part;  // in words: "zone 3"; empty: the whole file
  std::vector<ArrayShape> arrays;
};

/// Facts from the files that name an input's files.
struct InputLists {
  std::vector<std::string> notes = {};        // lines for Source::conversions()
  std::vector<DeclaredArrays> declared = {};  // by parallel files, for all of their pieces; the part is the file
};

/// The data sets of an input, one after the other. Not thread-safe.
class DataSets {
 public:
  virtual ~DataSets() = default;

  /// Number of data sets. A file that is not open yet counts as one.
  [[nodiscard]] virtual std::size_t count() const = 0;

  /// Returns the next data set, a null pointer after the last.
  [[nodiscard]] virtual Result<std::unique_ptr<DataSet>> next() = 0;

  /// Adds the arrays that headers announce, and those of data sets that are in memory. Reads no other data. Called
  /// before the second next(). An array that it does not add fails when it
  /// turns up later (ArrayUnion::check).
  [[nodiscard]] virtual Status announce(ArrayUnion& /*arrays*/) { return {}; }

  /// Returns the arrays that the file declares for the last data set, selected or not. The reader must give all of
  /// them.
  [[nodiscard]] virtual DeclaredArrays declared() const { return {}; }

  /// As Source::part_sizes() and Source::select(): parts are files. A data set that was returned already stays.
  [[nodiscard]] virtual std::vector<std::uint64_t> part_sizes() const { return {}; }
  virtual void select(const std::vector<std::uint64_t>& /*files*/) {}

  /// As Source::piece_number(), of the last data set.
  [[nodiscard]] virtual Source::PieceNumber number() const { return {}; }

  /// As Piece::block, of the last data set.
  [[nodiscard]] virtual std::uint64_t block() const { return 0; }

  /// How many blocks the first file tells apart, once it is open: bodies, zones or parts; 1: none.
  [[nodiscard]] virtual std::size_t blocks() const { return 1; }

  /// The word for such a block.
  [[nodiscard]] virtual std::string block_word() const { return "block"; }

  /// The number of the last data set's block, from 1 on, in the order of its file.
  [[nodiscard]] virtual std::size_t block_in_file() const { return 1; }

  /// The numbers that the file gives to the blocks of the last data set's cells; empty: all are in block_in_file().
  [[nodiscard]] virtual std::span<const int> blocks_of_cells() const { return {}; }

  /// The file of the last data set.
  [[nodiscard]] virtual const std::string& path() const = 0;

  /// Counts the cells of blocks that were left out so far, because they are surfaces; CellCensus::left_out: those that
  /// are no patches.
  [[nodiscard]] virtual CellCensus left_out() const { return {}; }

  /// Lines on what the files opened so far make of the input, for Source::conversions().
  [[nodiscard]] virtual std::set<std::string> notes() const { return {}; }

  /// The names of arrays in the files opened so far that are no solutions of points or of cells, and are left out.
  [[nodiscard]] virtual std::set<std::string> left_out_arrays() const { return {}; }

  /// Counts what the data sets since the last call have otherwise than their files: CellCensus::open_ends, unwritten.
  [[nodiscard]] virtual CellCensus take_changes() { return {}; }

  /// Returns the patches that were read since the last call, if InputFile::patches asks for them.
  [[nodiscard]] virtual std::vector<Patch> take_patches() { return {}; }

  /// Whether means of cells at a point that several data sets have differ from one to the other: each has the mean over
  /// its own cells.
  [[nodiscard]] virtual bool averages_by_data_set() const { return true; }

  /// Whether the reader rounds the points of the last data set to single precision.
  [[nodiscard]] virtual bool rounds_points() const { return false; }

  /// Whether single precision does not keep the points in the file of the last data set. Reads them.
  [[nodiscard]] virtual Result<bool> has_finer_points() { return false; }

  /// As Source::time_step(), for the first file that has been opened.
  [[nodiscard]] virtual std::optional<TimeStep> time_step() const { return std::nullopt; }
};

/// Whether an array of this name marks points or cells as ghost copies or hidden.
[[nodiscard]] inline bool is_ghost_array(std::string_view name) {
  return name == "vtkGhostType" || name == "vtkGhostLevels";
}

/// Whether a name is that of an array that VTK or a filter made for its own use.
[[nodiscard]] inline bool is_bookkeeping(std::string_view name) {
  return is_ghost_array(name) || name.starts_with("vtkOriginal") || name == "vtkValidPointMask" || name == "IBlank" ||
         name == "HigherOrderDegrees";
}

/// Returns those arrays that a selection needs, without bookkeeping.
[[nodiscard]] inline std::vector<ArrayShape> wanted_solutions(std::vector<ArrayShape> arrays,
                                                              const std::vector<std::string>& selection) {
  std::erase_if(arrays, [](const ArrayShape& array) { return is_bookkeeping(array.name); });
  return wanted_arrays(std::move(arrays), selection);
}

}  // namespace splatvol
