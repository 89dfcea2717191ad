// Lays a .vtu file out: its header, and where the numbers of its arrays go.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "base/error.h"
#include "base/file.h"

namespace splatvol {

/// Returns a text as an attribute of XML. `?` stands for each character that XML has no way to write, and for each byte
/// that is no UTF-8.
[[nodiscard]] std::string escape_xml(std::string_view text);

/// Fails if two attributes have one name in a .vtu file: VTK keeps one array of a name. `source`: the file that they
/// are from, for the message.
[[nodiscard]] Status check_vtu_names(const std::string& source, std::span<const std::string> names);

/// How many numbers a .vtu file has.
struct VtuCounts {
  std::uint64_t points = 0;
  std::uint64_t cells = 0;
  std::uint64_t corners = 0;  // of all cells
};

/// An array of a .vtu file. Its element of XML follows from what it has numbers for.
struct VtuArray {
  enum class Of { points, point_data, corners, cells, cell_data };

  Of of = Of::point_data;
  std::string name;
  const char* type = "Float64";
  std::size_t components = 1;
  std::size_t number_bytes = sizeof(double);
  std::string unit = {};
};

/// Returns the element of an array of appended data. `offset`: in the data, of the array's length.
[[nodiscard]] std::string vtk_array_element(const VtuArray& array, std::uint64_t offset);

/// A .vtu file of one piece: an UnstructuredGrid of the file version 1.0, with appended raw data and the mark of an
/// export (base/replaceable.h). Its user writes the numbers, in any order.
class VtuFile {
 public:
  /// Adds an array, whose numbers follow those of the arrays before. Returns its index.
  std::size_t add(VtuArray array);

  /// Adds the arrays of the cells: connectivity, offsets and types. Returns the index of the first.
  std::size_t add_cells();

  /// Leaves room for a header with any counts: the numbers of the first array may then be written before set_counts().
  /// Called after the last array is added.
  void reserve_header();

  /// Sets where everything is. Called after the last array is added.
  void set_counts(const VtuCounts& counts);

  /// Writes numbers of an array, from that of the point, cell or corner `first` on.
  [[nodiscard]] Status write(AtomicFile& file, std::size_t array, std::uint64_t first,
                             std::span<const std::byte> numbers) const;

  /// Returns the offset in the file of an array's numbers.
  [[nodiscard]] std::uint64_t offset(std::size_t array) const;

  /// Writes all but the numbers. Requires set_counts().
  [[nodiscard]] Status write_frame(AtomicFile& file) const;

  /// Returns the length of the file. Requires set_counts().
  [[nodiscard]] std::uint64_t bytes() const;

 private:
  struct Placed {
    VtuArray array;
    std::uint64_t bytes = 0;   // of its numbers
    std::uint64_t offset = 0;  // in the appended data: of the array's length; the numbers follow it
  };
  [[nodiscard]] std::string header() const;
  [[nodiscard]] std::uint64_t data_bytes() const;

  std::vector<Placed> arrays_;
  VtuCounts counts_;
  std::uint64_t reserved_ = 0;  // bytes of the header, at least
  std::uint64_t data_ = 0;      // where the appended data begins
};

}  // namespace splatvol
