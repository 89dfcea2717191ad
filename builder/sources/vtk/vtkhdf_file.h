// The arrays and attributes of an HDF5 file.
#pragma once

#include <cstdint>
#include <set>
#include <string>
#include <vector>

namespace splatvol {

/// A group of an HDF5 file. All functions throw a ReaderError if something is not there or damaged. Not thread-safe.
class Hdf5Group {
 public:
  /// Opens a group of a file.
  Hdf5Group(const std::string& path, const std::string& group);
  ~Hdf5Group();
  Hdf5Group(const Hdf5Group&) = delete;
  Hdf5Group& operator=(const Hdf5Group&) = delete;

  /// Whether there is an object of this name, such as "PointData/p".
  [[nodiscard]] bool has(const std::string& name) const;

  /// The names of all that is in a group; none if there is no such group.
  [[nodiscard]] std::vector<std::string> names_in(const std::string& group) const;

  /// Whether an array holds numbers: not texts. Throws if its link leads nowhere, or if it holds something else.
  [[nodiscard]] bool holds_numbers(const std::string& array) const;

  /// Attributes of the group itself, or of a group in it.
  [[nodiscard]] bool has_attribute(const std::string& name, const std::string& group = ".") const;
  [[nodiscard]] std::vector<double> attribute(const std::string& name, const std::string& group = ".") const;
  [[nodiscard]] std::string text_attribute(const std::string& name) const;

  /// The extents of an array, the slowest first.
  [[nodiscard]] std::vector<std::uint64_t> shape(const std::string& array) const;

  /// Reads the rows [first, first + count) of an array, the numbers of a row side by side.
  [[nodiscard]] std::vector<double> doubles(const std::string& array, std::uint64_t first, std::uint64_t count) const;
  [[nodiscard]] std::vector<std::int64_t> integers(const std::string& array, std::uint64_t first,
                                                   std::uint64_t count) const;

 private:
  template <class T>
  std::vector<T> read(const std::string& array, std::uint64_t first, std::uint64_t count, std::int64_t type) const;

  std::int64_t file_ = -1;
  std::int64_t group_ = -1;
  mutable std::set<std::string> checked_;  // arrays whose values are there
};

}  // namespace splatvol
