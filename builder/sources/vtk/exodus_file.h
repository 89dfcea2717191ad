// The header of an Exodus file, as far as VTK's reader does not look at it.
#pragma once

#include <cstdint>
#include <map>
#include <set>
#include <string>
#include <vector>

namespace splatvol {

/// Facts of an Exodus file. Numbers of variables and of blocks count from 0, in the order of the file.
struct ExodusHeader {
  struct Block {
    int number = 0;
    std::string type;        // "HEX8"; empty: it has no cells
    std::int64_t nodes = 0;  // of a cell; of polygons and polyhedra: of all
  };
  bool single = false;           // coordinates have 4 bytes
  std::vector<double> times;     // of the steps, if the file leaves their number open (count_open_records)
  std::map<int, Block> blocks;   // by id
  std::set<std::string> values;  // the names of NetCDF's variables with values of Exodus's variables
  bool in_one_array = false;     // an older file: one of them has the values of all variables of the points

  /// Whether a variable that is declared has values: of the points, or of a block's cells.
  [[nodiscard]] bool has_nodal_values(int variable) const;
  [[nodiscard]] bool has_element_values(int block, int variable) const;
};

/// Reads the header; an empty one if VTK's reader will tell what is wrong with the file. Throws ReaderError if two
/// blocks or sets of one kind have the same id, or if a block's cells have fewer nodes than corners: VTK 9.1 then reads
/// past the end of its lists. Call it inside run_vtk.
[[nodiscard]] ExodusHeader read_exodus_header(const std::string& path);

}  // namespace splatvol
