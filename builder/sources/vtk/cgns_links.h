// What VTK's CGNS library finds in HDF5 files.
#pragma once

#include <set>
#include <string>

namespace splatvol {

/// To be called before a CGNS file is opened. From then on the HDF5 library lists the links of a group by name if the
/// file does not keep the order of their creation, and leaves out solutions on faces or edges: the CGNS library would
/// find nothing in such groups, and fail at such solutions. Not thread-safe.
void begin_cgns_file();

/// The names of arrays in solutions that were left out since then.
[[nodiscard]] const std::set<std::string>& hidden_cgns_arrays();

}  // namespace splatvol
