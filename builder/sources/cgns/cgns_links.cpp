// Files of CGNS before 3.2, and those of other writers such as h5py, do not keep the order in which links were created.
// The library asks for that order nevertheless. So these functions stand before those of the HDF5 library.
#include "builder/sources/cgns/cgns_links.h"

#include <dlfcn.h>
#include <vtk_hdf5.h>

#include <array>

#include "builder/sources/hdf5/hdf5_checks.h"

#define SPLATVOL_TEXT(name) #name
#define SPLATVOL_NAME(name) SPLATVOL_TEXT(name)  // H5Literate may be a macro for a version of it

namespace splatvol {
namespace {

std::set<std::string>& hidden_arrays() {
  static std::set<std::string> names;
  return names;
}

H5_index_t kept_index(hid_t group, H5_index_t index) {
  if (index != H5_INDEX_CRT_ORDER) return index;
  const Hdf5Handle plan(H5Gget_create_plist(group), H5Pclose);
  unsigned int order = 0;
  const bool is_kept = plan.is_open() && H5Pget_link_creation_order(plan.id(), &order) >= 0 && order != 0;
  return is_kept ? index : H5_INDEX_NAME;
}

/// The label of a node: its type in CGNS. Empty if it has none.
std::string label_of(hid_t node) {
  std::array<char, 33> text{};  // the last byte stays 0
  if (H5Aexists(node, "label") <= 0) return {};
  const Hdf5Handle label(H5Aopen(node, "label", H5P_DEFAULT), H5Aclose);
  const Hdf5Handle type(label.is_open() ? H5Aget_type(label.id()) : -1, H5Tclose);
  if (!type.is_open() || H5Tget_class(type.id()) != H5T_STRING || H5Tis_variable_str(type.id()) != 0 ||
      H5Aget_storage_size(label.id()) > text.size() || H5Aread(label.id(), type.id(), text.data()) < 0)
    return {};
  text.back() = '\0';
  return text.data();
}

/// The text of a solution's GridLocation.
std::string location_of(hid_t solution) {
  std::array<char, 33> text{};
  if (H5Lexists(solution, "GridLocation", H5P_DEFAULT) <= 0 ||
      H5Lexists(solution, "GridLocation/ data", H5P_DEFAULT) <= 0)
    return {};
  const Hdf5Handle data(H5Dopen2(solution, "GridLocation/ data", H5P_DEFAULT), H5Dclose);
  const Hdf5Handle space(data.is_open() ? H5Dget_space(data.id()) : -1, H5Sclose);
  const hssize_t length = space.is_open() ? H5Sget_simple_extent_npoints(space.id()) : 0;
  if (length < 1 || length >= static_cast<hssize_t>(text.size()) ||
      H5Dread(data.id(), H5T_NATIVE_SCHAR, H5S_ALL, H5S_ALL, H5P_DEFAULT, text.data()) < 0)
    return {};
  return text.data();
}

/// A visit to the links of a group.
struct Visit {
  H5L_iterate_t call;
  void* data;
  bool is_zone;
};

herr_t visit_array(hid_t solution, const char* name, const H5L_info_t* /*info*/, void* /*data*/) {
  const Hdf5Handle node(H5Oopen(solution, name, H5P_DEFAULT), H5Oclose);
  if (node.is_open() && label_of(node.id()) == "DataArray_t") hidden_arrays().insert(name);
  return 0;
}

herr_t visit_link(hid_t group, const char* name, const H5L_info_t* info, void* data) {
  const Visit& visit = *static_cast<Visit*>(data);
  if (visit.is_zone) {
    const Hdf5Handle node(H5Oopen(group, name, H5P_DEFAULT), H5Oclose);
    const bool is_solution = node.is_open() && label_of(node.id()) == "FlowSolution_t";
    const std::string location = is_solution ? location_of(node.id()) : std::string();
    if (location == "FaceCenter" || location == "EdgeCenter") {
      H5Literate(node.id(), H5_INDEX_NAME, H5_ITER_NATIVE, nullptr, visit_array, nullptr);
      return 0;
    }
  }
  return visit.call(group, name, info, visit.data);
}

/// The function of this name in the HDF5 library.
template <class Function>
Function* library_function(const char* name, Function& /*same type*/) {
  return reinterpret_cast<Function*>(dlsym(RTLD_NEXT, name));
}

}  // namespace

void begin_cgns_file() { hidden_arrays().clear(); }

const std::set<std::string>& hidden_cgns_arrays() { return hidden_arrays(); }

}  // namespace splatvol

extern "C" {

__attribute__((visibility("default"))) herr_t H5Literate(hid_t group, H5_index_t index, H5_iter_order_t order,
                                                         hsize_t* at, H5L_iterate_t call, void* data) {
  static auto* const original = splatvol::library_function(SPLATVOL_NAME(H5Literate), H5Literate);
  splatvol::Visit visit{call, data, splatvol::label_of(group) == "Zone_t"};
  return original ? original(group, splatvol::kept_index(group, index), order, at, splatvol::visit_link, &visit) : -1;
}

__attribute__((visibility("default"))) herr_t H5Literate_by_name(hid_t place, const char* name, H5_index_t index,
                                                                 H5_iter_order_t order, hsize_t* at, H5L_iterate_t call,
                                                                 void* data, hid_t access) {
  static auto* const original = splatvol::library_function(SPLATVOL_NAME(H5Literate_by_name), H5Literate_by_name);
  const splatvol::Hdf5Handle group(H5Gopen2(place, name, access), H5Gclose);
  splatvol::Visit visit{call, data, splatvol::label_of(group.id()) == "Zone_t"};
  return original ? original(place, name, splatvol::kept_index(group.id(), index), order, at, splatvol::visit_link,
                             &visit, access)
                  : -1;
}
}
