#include "builder/sources/hdf5/hdf5_checks.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <exception>
#include <filesystem>
#include <optional>
#include <string_view>

#include "base/file.h"
#include "builder/sources/reader_error.h"
#include "builder/sources/source.h"

namespace splatvol {
namespace {

/// Where the library looks for a file of raw data: in the current folder, unless the environment names another.
std::string raw_path(const std::string& name, hid_t array) {
  const char* set = std::getenv("HDF5_EXTFILE_PREFIX");
  const std::filesystem::path path(name);
  if (path.is_absolute() || !set || !*set || std::string_view(set) == ".") return name;
  constexpr std::string_view origin = "${ORIGIN}";
  std::string prefix = set;
  if (prefix.starts_with(origin)) {
    std::array<char, 4096> file{};
    H5Fget_name(array, file.data(), file.size());
    prefix.replace(0, origin.size(), folder_of(file.data()));
  }
  return std::filesystem::path(prefix) / path;
}

/// The library reads zeros behind the end of a file of raw data.
void check_raw_files(hid_t array, hid_t plan, const std::string& name) {
  std::uint64_t left = H5Dget_storage_size(array);
  const int files = H5Pget_external_count(plan);
  for (int i = 0; i < files && left > 0; ++i) {
    std::array<char, 4096> file{};
    off_t offset = 0;
    hsize_t size = 0;
    if (H5Pget_external(plan, static_cast<unsigned>(i), file.size() - 1, file.data(), &offset, &size) < 0)
      throw ReaderError("the array \"{}\" is damaged", name);
    const std::uint64_t bytes = std::min<std::uint64_t>(left, size), first = static_cast<std::uint64_t>(offset);
    const auto opened = open_file(raw_path(file.data(), array));
    if (!opened) throw ReaderError("the values of \"{}\" are in a file of their own: {}", name, opened.error().message);
    const std::uint64_t there = (*opened)->size() - std::min(first, (*opened)->size());
    if (bytes > there)
      throw ReaderError("the values of \"{}\" are cut off: {} has {} of their {} bytes", name, (*opened)->name(), there,
                        bytes);
    left -= bytes;
  }
}

/// Whether what was not written reads as a missing value.
bool fills_with_missing(hid_t plan) {
  H5D_fill_value_t kind = H5D_FILL_VALUE_ERROR;
  double fill = 0;
  return H5Pfill_value_defined(plan, &kind) >= 0 && kind == H5D_FILL_VALUE_USER_DEFINED &&
         H5Pget_fill_value(plan, H5T_NATIVE_DOUBLE, &fill) >= 0 && MissingValues().has(fill);
}

enum class Stored { all, parts, nothing };

/// How much of an array was written: each chunk may lack by itself. Empty if the file is damaged.
std::optional<Stored> stored_share(hid_t array, hid_t plan, hid_t space) {
  H5D_space_status_t status = H5D_SPACE_STATUS_ERROR;
  if (H5Dget_space_status(array, &status) < 0) return std::nullopt;
  if (status == H5D_SPACE_STATUS_NOT_ALLOCATED) return Stored::nothing;
  if (status == H5D_SPACE_STATUS_ALLOCATED || H5Pget_layout(plan) != H5D_CHUNKED) return Stored::all;
  // Compressed chunks never take as many bytes as all values.
  std::array<hsize_t, H5S_MAX_RANK> extents{}, sides{};
  const int rank = H5Sget_simple_extent_dims(space, extents.data(), nullptr);
  hsize_t written = 0;
  if (H5Pget_chunk(plan, rank, sides.data()) != rank || H5Dget_num_chunks(array, space, &written) < 0)
    return std::nullopt;
  double chunks = 1;
  for (std::size_t axis = 0; axis < static_cast<std::size_t>(rank); ++axis)
    chunks *= std::ceil(static_cast<double>(extents[axis]) / static_cast<double>(sides[axis]));
  return static_cast<double>(written) >= chunks ? Stored::all : Stored::parts;
}

void check_values(hid_t array, const std::string& name, Hdf5Arrays written) {
  const Hdf5Handle plan(H5Dget_create_plist(array), H5Pclose);
  const Hdf5Handle space(H5Dget_space(array), H5Sclose);
  const hssize_t values = space.is_open() ? H5Sget_simple_extent_npoints(space.id()) : -1;
  if (values == 0) return;
  if (values > 0 && H5Pget_layout(plan.id()) == H5D_VIRTUAL)
    throw ReaderError("the array \"{}\" is a view of arrays elsewhere (a virtual one): copy its values into it", name);
  const auto stored = values > 0 ? stored_share(array, plan.id(), space.id()) : std::nullopt;
  if (!stored) throw ReaderError("the array \"{}\" is damaged", name);
  if (H5Pget_external_count(plan.id()) > 0) return check_raw_files(array, plan.id(), name);
  if (written == Hdf5Arrays::any || *stored == Stored::all || fills_with_missing(plan.id())) return;
  throw ReaderError("the array \"{}\" was {}", name,
                    *stored == Stored::nothing ? "never written" : "written in parts only: it is cut off");
}

/// A visit to all of a file, through functions of C. It ends at the first failure.
struct Visit {
  Hdf5Arrays written;
  std::exception_ptr failure = nullptr;

  template <class Call>
  herr_t keep_failure(const Call& call) {
    try {
      call();
      return 0;
    } catch (...) {
      failure = std::current_exception();
      return 1;
    }
  }
};

herr_t visit_object(hid_t root, const char* name, const H5O_info_t* info, void* data) {
  auto& visit = *static_cast<Visit*>(data);
  if (info->type != H5O_TYPE_DATASET) return 0;
  return visit.keep_failure([&] {
    const Hdf5Handle array(H5Dopen2(root, name, H5P_DEFAULT), H5Dclose);
    if (!array.is_open()) throw ReaderError("the array \"{}\" is damaged", name);
    const Hdf5Handle type(H5Dget_type(array.id()), H5Tclose);
    const H5T_class_t kind = H5Tget_class(type.id());
    if (kind == H5T_INTEGER || kind == H5T_FLOAT) check_values(array.id(), name, visit.written);
  });
}

herr_t visit_link(hid_t root, const char* name, const H5L_info_t* info, void* data) {
  auto& visit = *static_cast<Visit*>(data);
  if (info->type == H5L_TYPE_HARD) return 0;
  return visit.keep_failure([&] {
    if (H5Oexists_by_name(root, name, H5P_DEFAULT) <= 0)
      throw ReaderError("the link \"{}\" leads nowhere: a file or a part of one is missing", name);
  });
}

}  // namespace

void forbid_hdf5_plugins() { H5PLset_loading_state(0); }

bool holds_numbers(const Hdf5Handle& object, const std::string& name) {
  if (!object.is_open())
    throw ReaderError("\"{}\" is a link that leads nowhere, or damaged: a file or a part of one is missing", name);
  if (H5Iget_type(object.id()) != H5I_DATASET)
    throw ReaderError("\"{}\" is a group, and no array: name the others by --attribute", name);
  const Hdf5Handle type(H5Dget_type(object.id()), H5Tclose);
  const H5T_class_t kind = H5Tget_class(type.id());
  if (kind == H5T_INTEGER || kind == H5T_FLOAT) return true;
  if (kind == H5T_STRING) return false;
  throw ReaderError("the array \"{}\" holds neither numbers nor texts: name the others by --attribute", name);
}

void check_values(hid_t array, const std::string& name) { check_values(array, name, Hdf5Arrays::all); }

void check_hdf5_file(const std::string& path, Hdf5Arrays written) {
  H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr);  // keeps the library from printing its errors
  const Hdf5Handle file(H5Fopen(path.c_str(), H5F_ACC_RDONLY, H5P_DEFAULT), H5Fclose);
  if (!file.is_open()) return;  // no HDF5 file, or the library of the format tells
  Visit visit{written};
  H5Ovisit(file.id(), H5_INDEX_NAME, H5_ITER_NATIVE, visit_object, &visit);
  if (!visit.failure) H5Lvisit(file.id(), H5_INDEX_NAME, H5_ITER_NATIVE, visit_link, &visit);
  if (visit.failure) std::rethrow_exception(visit.failure);
}

}  // namespace splatvol
