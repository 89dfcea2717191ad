#include "builder/sources/vtk/vtkhdf_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <utility>

#include "builder/sources/vtk/hdf5_checks.h"
#include "builder/sources/vtk/messages.h"

namespace splatvol {
namespace {

[[noreturn]] void fail_array(const std::string& name) {
  throw ReaderError(fmt::format("the array \"{}\" is missing, damaged or too short", name));
}

/// A packed array cannot be smaller than this share of its numbers: deflate packs 1032 times at most.
constexpr std::uint64_t most_packing = 1100;

}  // namespace

Hdf5Group::Hdf5Group(const std::string& path, const std::string& group) {
  H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr);
  file_ = H5Fopen(path.c_str(), H5F_ACC_RDONLY, H5P_DEFAULT);
  if (file_ >= 0) group_ = H5Gopen2(file_, group.c_str(), H5P_DEFAULT);
  if (group_ >= 0) return;
  if (file_ >= 0) H5Fclose(file_);
  throw ReaderError(file_ < 0 ? "damaged, cut off, or not an HDF5 file"
                              : fmt::format("not a VTKHDF file: it has no group {}", group));
}

Hdf5Group::~Hdf5Group() {
  H5Gclose(group_);
  H5Fclose(file_);
}

bool Hdf5Group::has(const std::string& name) const {
  for (std::size_t at = name.find('/'); at != std::string::npos; at = name.find('/', at + 1))
    if (H5Lexists(group_, name.substr(0, at).c_str(), H5P_DEFAULT) <= 0) return false;
  return H5Lexists(group_, name.c_str(), H5P_DEFAULT) > 0;
}

std::vector<std::string> Hdf5Group::names_in(const std::string& group) const {
  std::vector<std::string> names;
  if (!has(group)) return names;
  const Hdf5Handle opened(H5Gopen2(group_, group.c_str(), H5P_DEFAULT), H5Gclose);
  H5G_info_t info{};
  if (!opened.is_open() || H5Gget_info(opened.id(), &info) < 0) fail_array(group);
  for (hsize_t i = 0; i < info.nlinks; ++i) {
    std::array<char, 1024> name{};
    if (H5Lget_name_by_idx(opened.id(), ".", H5_INDEX_NAME, H5_ITER_INC, i, name.data(), name.size(), H5P_DEFAULT) < 0)
      fail_array(group);
    names.emplace_back(name.data());
  }
  return names;
}

bool Hdf5Group::holds_numbers(const std::string& array) const {
  return splatvol::holds_numbers(Hdf5Handle(H5Oopen(group_, array.c_str(), H5P_DEFAULT), H5Oclose), array);
}

bool Hdf5Group::has_attribute(const std::string& name, const std::string& group) const {
  return H5Aexists_by_name(group_, group.c_str(), name.c_str(), H5P_DEFAULT) > 0;
}

std::vector<double> Hdf5Group::attribute(const std::string& name, const std::string& group) const {
  const Hdf5Handle attribute(H5Aopen_by_name(group_, group.c_str(), name.c_str(), H5P_DEFAULT, H5P_DEFAULT), H5Aclose);
  if (!attribute.is_open()) throw ReaderError(fmt::format("the attribute {} is missing", name));
  const Hdf5Handle space(H5Aget_space(attribute.id()), H5Sclose);
  const hssize_t count = H5Sget_simple_extent_npoints(space.id());
  if (count < 1 || count > 64) throw ReaderError(fmt::format("the attribute {} is damaged", name));
  std::vector<double> numbers(static_cast<std::size_t>(count));
  if (H5Aread(attribute.id(), H5T_NATIVE_DOUBLE, numbers.data()) < 0)
    throw ReaderError(fmt::format("the attribute {} is damaged", name));
  return numbers;
}

std::string Hdf5Group::text_attribute(const std::string& name) const {
  const Hdf5Handle attribute(H5Aopen(group_, name.c_str(), H5P_DEFAULT), H5Aclose);
  if (!attribute.is_open()) throw ReaderError(fmt::format("the attribute {} is missing", name));
  const Hdf5Handle type(H5Aget_type(attribute.id()), H5Tclose);
  if (H5Tget_class(type.id()) != H5T_STRING) throw ReaderError(fmt::format("the attribute {} is no text", name));
  if (H5Tis_variable_str(type.id()) > 0) {
    char* text = nullptr;
    if (H5Aread(attribute.id(), type.id(), static_cast<void*>(&text)) < 0 || !text)
      throw ReaderError(fmt::format("the attribute {} is damaged", name));
    std::string copy(text);
    H5free_memory(text);
    return copy;
  }
  std::string text(std::min<std::size_t>(H5Tget_size(type.id()), 4096), '\0');
  if (H5Tget_size(type.id()) > text.size() || H5Aread(attribute.id(), type.id(), text.data()) < 0)
    throw ReaderError(fmt::format("the attribute {} is damaged", name));
  return text.substr(0, text.find('\0'));
}

std::vector<std::uint64_t> Hdf5Group::shape(const std::string& array) const {
  if (!has(array)) fail_array(array);
  const Hdf5Handle opened(H5Dopen2(group_, array.c_str(), H5P_DEFAULT), H5Dclose);
  const Hdf5Handle space(opened.is_open() ? H5Dget_space(opened.id()) : -1, H5Sclose);
  const int rank = space.is_open() ? H5Sget_simple_extent_ndims(space.id()) : 0;
  if (rank < 1 || rank > 8) fail_array(array);
  std::vector<hsize_t> extents(static_cast<std::size_t>(rank));
  H5Sget_simple_extent_dims(space.id(), extents.data(), nullptr);
  return {extents.begin(), extents.end()};
}

template <class T>
std::vector<T> Hdf5Group::read(const std::string& array, std::uint64_t first, std::uint64_t count,
                               std::int64_t type) const {
  const std::vector<std::uint64_t> extents = shape(array);
  if (count > extents[0] || first > extents[0] - count) fail_array(array);
  const Hdf5Handle opened(H5Dopen2(group_, array.c_str(), H5P_DEFAULT), H5Dclose);
  const Hdf5Handle space(H5Dget_space(opened.id()), H5Sclose);
  if (checked_.insert(array).second) check_values(opened.id(), array);

  // Numbers that the file cannot hold are not allocated for.
  std::uint64_t left = H5Dget_storage_size(opened.id()) * most_packing, numbers = count;
  for (std::size_t axis = 0; axis < extents.size(); ++axis) {
    const std::uint64_t extent = axis == 0 ? count : extents[axis];
    if (extent != 0 && left / extent == 0) fail_array(array);
    left = extent == 0 ? left : left / extent;
    numbers = axis == 0 ? count : numbers * extent;
  }
  std::vector<T> values(numbers);
  if (numbers == 0) return values;
  std::vector<hsize_t> start(extents.size()), counts(extents.begin(), extents.end());
  start[0] = first;
  counts[0] = count;
  const Hdf5Handle memory(H5Screate_simple(static_cast<int>(counts.size()), counts.data(), nullptr), H5Sclose);
  if (H5Sselect_hyperslab(space.id(), H5S_SELECT_SET, start.data(), nullptr, counts.data(), nullptr) < 0 ||
      H5Dread(opened.id(), type, memory.id(), space.id(), H5P_DEFAULT, values.data()) < 0)
    fail_array(array);
  return values;
}

std::vector<double> Hdf5Group::doubles(const std::string& array, std::uint64_t first, std::uint64_t count) const {
  return read<double>(array, first, count, H5T_NATIVE_DOUBLE);
}

std::vector<std::int64_t> Hdf5Group::integers(const std::string& array, std::uint64_t first,
                                              std::uint64_t count) const {
  return read<std::int64_t>(array, first, count, H5T_NATIVE_INT64);
}

}  // namespace splatvol
