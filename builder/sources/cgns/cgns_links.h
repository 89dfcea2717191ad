// Changes how VTK's CGNS library looks into HDF5 files.
#pragma once

#include <set>
#include <string>

namespace splatvol {

/// To be called before a CGNS file is opened. Not thread-safe. From then on the HDF5 library behaves differently:
///
/// - It lists the links of a group by name if the file does not keep the order of their creation. The CGNS library
///   would find nothing in such a group.
/// - It leaves out solutions on faces or edges. The CGNS library would fail at them.
void begin_cgns_file();

/// The names of arrays in solutions that were left out since then.
[[nodiscard]] const std::set<std::string>& hidden_cgns_arrays();

}  // namespace splatvol
