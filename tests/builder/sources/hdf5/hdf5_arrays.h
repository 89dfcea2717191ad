// Groups, attributes and arrays of HDF5 files, for tests that write them.
#pragma once

#include <vtk_hdf5.h>

#include <array>
#include <cstdint>
#include <string>
#include <type_traits>
#include <vector>

namespace splatvol::test {

inline void put_attribute(hid_t group, const char* name, hid_t type, const void* values, hsize_t count) {
  const hid_t space = H5Screate_simple(1, &count, nullptr);
  const hid_t attribute = H5Acreate2(group, name, type, space, H5P_DEFAULT, H5P_DEFAULT);
  H5Awrite(attribute, type, values);
  H5Aclose(attribute);
  H5Sclose(space);
}

/// Puts the version and the type of a VTKHDF file.
inline void put_type(hid_t group, const std::string& type) {
  const std::array<std::int64_t, 2> version = {2, 0};
  put_attribute(group, "Version", H5T_NATIVE_INT64, version.data(), 2);
  const hid_t text = H5Tcopy(H5T_C_S1), space = H5Screate(H5S_SCALAR);
  H5Tset_size(text, type.size());
  const hid_t attribute = H5Acreate2(group, "Type", text, space, H5P_DEFAULT, H5P_DEFAULT);
  H5Awrite(attribute, text, type.data());
  H5Aclose(attribute);
  H5Sclose(space);
  H5Tclose(text);
}

/// `plan`: how the array is stored. Without `values` it is not written.
template <class T>
void put_array(hid_t group, const char* name, const std::vector<T>& values, std::vector<hsize_t> shape = {},
               hid_t plan = H5P_DEFAULT) {
  const hid_t type = std::is_same_v<T, double> ? H5T_NATIVE_DOUBLE : H5T_NATIVE_INT64;
  if (shape.empty()) shape = {values.size()};
  const hid_t space = H5Screate_simple(static_cast<int>(shape.size()), shape.data(), nullptr);
  const hid_t array = H5Dcreate2(group, name, type, space, H5P_DEFAULT, plan, H5P_DEFAULT);
  if (!values.empty()) H5Dwrite(array, type, H5S_ALL, H5S_ALL, H5P_DEFAULT, values.data());
  H5Dclose(array);
  H5Sclose(space);
}

inline hid_t make_group(hid_t parent, const char* name) {
  return H5Gcreate2(parent, name, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT);
}

/// Puts a tetrahedron with four points into the root of a VTKHDF file.
inline void put_tetrahedron(hid_t root) {
  put_type(root, "UnstructuredGrid");
  put_array<double>(root, "Points", {0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1}, {4, 3});
  for (const char* count : {"NumberOfPoints", "NumberOfConnectivityIds"}) put_array<std::int64_t>(root, count, {4});
  put_array<std::int64_t>(root, "NumberOfCells", {1});
  put_array<std::int64_t>(root, "Connectivity", {0, 1, 2, 3});
  put_array<std::int64_t>(root, "Offsets", {0, 4});
  put_array<std::int64_t>(root, "Types", {10});
}

}  // namespace splatvol::test
