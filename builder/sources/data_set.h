// A mesh with its arrays, wherever they lie: what makes pieces of one needs to know of it.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "base/error.h"
#include "base/math.h"
#include "builder/sources/array_attributes.h"
#include "builder/sources/array_union.h"
#include "builder/sources/reader_error.h"

namespace splatvol {

/// An array of numbers. Thread-safe.
class NumberArray {
 public:
  virtual ~NumberArray() = default;
  [[nodiscard]] virtual int components() const = 0;

  /// Number of its elements: points or cells.
  [[nodiscard]] virtual std::uint64_t size() const = 0;

  /// Reads one component, an element for each index. Requires indices in range.
  virtual void read(int component, std::span<const std::uint32_t> elements, std::span<double> values) const = 0;
};

/// The array of an attribute, and whether it is one of the cells. It may outlive the data set. Null: there is none.
struct FoundArray {
  std::shared_ptr<const NumberArray> array;
  bool of_cells = false;
};

/// Bits of a ghost flag, as VTK's vtkGhostType has them. The other bits of cells hide nothing: they tell of more
/// neighbours than in a regular mesh (2), of fewer (4), and of the outside (16).
namespace ghost {
inline constexpr std::uint8_t duplicate = 1;     // another piece has it
inline constexpr std::uint8_t hidden_point = 2;  // of points
inline constexpr std::uint8_t refined_cell = 8;  // of cells: finer cells fill the same volume
inline constexpr std::uint8_t hidden_cell = 32;  // of cells
inline constexpr std::uint8_t left_out_cell = duplicate | refined_cell | hidden_cell;
}  // namespace ghost

/// Nothing of what it returns needs to be valid: numbers of points may be out of range.
class DataSet {
 public:
  virtual ~DataSet() = default;

  [[nodiscard]] virtual std::uint64_t point_count() const = 0;
  [[nodiscard]] virtual std::uint64_t cell_count() const = 0;

  /// Reads all positions. Requires room for point_count().
  virtual void read_points(std::span<dvec3> points) const = 0;

  /// Fails if the arrays of the cells do not fit each other. Called before the first cell is read. `name` begins the
  /// message.
  [[nodiscard]] virtual Status check_cells(const std::string& name) const = 0;

  /// Returns VTK's number of a cell's type.
  [[nodiscard]] virtual int cell_type(std::uint64_t cell) const = 0;

  /// Appends the numbers of a cell's points.
  virtual void append_points(std::uint64_t cell, std::vector<std::int64_t>& points) const = 0;

  /// The faces of polyhedra: for each the number of its faces, then for each face its number of points and these.
  /// Returns the length of this stream, where a cell begins in it (negative: nowhere), and a number of it.
  [[nodiscard]] virtual std::int64_t face_stream_length() const { return 0; }
  [[nodiscard]] virtual std::int64_t face_location([[maybe_unused]] std::uint64_t cell) const { return -1; }
  [[nodiscard]] virtual std::int64_t face_number([[maybe_unused]] std::int64_t at) const { return 0; }

  /// Flags of cells and of points; none: no cell, or no point, is a ghost.
  [[nodiscard]] virtual std::span<const std::uint8_t> cell_ghosts() const { return {}; }
  [[nodiscard]] virtual std::span<const std::uint8_t> point_ghosts() const { return {}; }

  /// Whether its points are a grid. A cell of the type "empty" is a blanked one then. The axes may be left-handed:
  /// coordinates that descend, a mirror in a matrix of directions.
  [[nodiscard]] virtual bool is_structured() const { return false; }

  /// Counts of cells, for a data set that can only have cells without volume; they are not read then.
  struct FlatCells {
    std::string_view name;
    int dimension;
    std::uint64_t count;
  };
  [[nodiscard]] virtual std::optional<std::vector<FlatCells>> flat_cells() const { return std::nullopt; }

  /// Whether a cell of higher order has the same degree in all directions, as far as the data set tells.
  [[nodiscard]] virtual bool has_one_degree([[maybe_unused]] std::uint64_t cell) const { return true; }

  /// Returns where the points of a cell of higher order lie in the unit cell; none if that is not known.
  [[nodiscard]] virtual std::vector<dvec3> parametric_points([[maybe_unused]] int type,
                                                             [[maybe_unused]] std::size_t count) const {
    return {};
  }

  /// Lists the arrays that give attributes, with their units as far as the data set tells. Texts, ghost flags and ids
  /// give none.
  [[nodiscard]] virtual std::vector<ArrayShape> arrays() const = 0;

  /// Returns the array of a name, of the cells or of the points; none if it is not there, null if it holds no numbers.
  [[nodiscard]] virtual std::optional<std::shared_ptr<const NumberArray>> array(const std::string& name,
                                                                                bool of_cells) const = 0;

  /// Adds an array with a number for each cell.
  virtual void add_cell_values(const std::string& name, std::vector<double> values) = 0;

  /// Changes means of cells at its points. A point that belongs to other data sets of the same mesh, too, gets the mean
  /// over the cells of all. `means`: those of a component, of the cells of this data set.
  virtual void share_means(const std::string& /*array*/, int /*component*/, std::span<double> /*means*/) const {}

  /// The time that it states.
  [[nodiscard]] virtual std::optional<double> stated_time() const { return std::nullopt; }

  /// Runs a `call` that uses the data set. An error that its library reports, or an exception, becomes an Error that
  /// begins with `path`.
  [[nodiscard]] virtual Status guard(const std::string& path, const std::function<void()>& call) const {
    return run_reader(path, call);
  }
};

/// Finds the array of an attribute. If the data set does not have it, takes one of the same name that belongs to the
/// other of points and cells, unless this is another attribute (ArrayAttribute::has_twin). Fails if the array holds no
/// numbers, has another number of components, or is too short; `path` begins the message.
[[nodiscard]] Result<FoundArray> find_array(const std::string& path, const DataSet& data,
                                            const ArrayAttribute& attribute);

/// Returns one component of the first elements of an array. Requires that it has so many.
[[nodiscard]] std::vector<double> component_values(const NumberArray& array, int component, std::uint64_t count);

}  // namespace splatvol
