#include "builder/sources/vtk/exodus_file.h"

#include <fmt/format.h>
#include <vtk_exodusII.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <filesystem>
#include <string_view>

#include "builder/sources/vtk/messages.h"
#include "builder/sources/vtk/netcdf_checks.h"

namespace splatvol {
namespace {

class ExodusFile {
 public:
  explicit ExodusFile(const std::string& path) : bytes_(std::filesystem::file_size(path)) {
    int real_bytes = 8, stored_real_bytes = 0;
    float version = 0;
    id_ = ex_open(path.c_str(), EX_READ | EX_ALL_INT64_API, &real_bytes, &stored_real_bytes, &version);
  }
  ~ExodusFile() {
    if (is_open()) ex_close(id_);
  }
  ExodusFile(const ExodusFile&) = delete;
  ExodusFile& operator=(const ExodusFile&) = delete;

  [[nodiscard]] bool is_open() const { return id_ >= 0; }
  [[nodiscard]] int id() const { return id_; }

  /// The ids of blocks or sets of a kind; none if the file is too small for them. Ids are 0 in a file that is cut off
  /// before them.
  [[nodiscard]] std::vector<std::int64_t> ids(ex_entity_type type, ex_inquiry count_of_type) const {
    const auto count = ex_inquire_int(id_, count_of_type);
    if (count < 1 || static_cast<std::uintmax_t>(count) > bytes_) return {};
    std::vector<std::int64_t> ids(static_cast<std::size_t>(count));
    if (ex_get_ids(id_, type, ids.data()) < 0) return {};
    return ids;
  }

  /// The names of NetCDF's variables that begin with `start`.
  [[nodiscard]] std::set<std::string> variables(std::string_view start) const {
    int count = 0;
    std::set<std::string> names;
    std::array<char, NC_MAX_NAME + 1> name{};
    if (nc_inq_nvars(id_, &count) != NC_NOERR) return names;
    for (int v = 0; v < count; ++v)
      if (nc_inq_varname(id_, v, name.data()) == NC_NOERR && std::string_view(name.data()).starts_with(start))
        names.emplace(name.data());
    return names;
  }

  /// Whether coordinates, and the values of all variables of the points, lie in one array each.
  [[nodiscard]] bool has_old_model() const { return ex_large_model(id_) == 0; }

  /// Whether the coordinates are stored as numbers of 4 bytes.
  [[nodiscard]] bool has_single_coordinates() const {
    int variable = 0;
    nc_type type = NC_NAT;
    return nc_inq_varid(id_, has_old_model() ? "coord" : "coordx", &variable) == NC_NOERR &&
           nc_inq_vartype(id_, variable, &type) == NC_NOERR && type == NC_FLOAT;
  }

  /// The times of so many steps; their numbers, as VTK's reader has it, if the file does not tell.
  [[nodiscard]] std::vector<double> times(std::size_t steps) const {
    std::vector<double> times(steps);
    int variable = 0;
    const bool told = nc_inq_varid(id_, "time_whole", &variable) == NC_NOERR;
    for (std::size_t step = 0; step < steps; ++step) {
      constexpr std::size_t one = 1;
      if (!told || nc_get_vara_double(id_, variable, &step, &one, &times[step]) != NC_NOERR)
        times[step] = static_cast<double>(step);
    }
    return times;
  }

 private:
  std::uintmax_t bytes_;
  int id_ = -1;
};

void check_ids(const ExodusFile& file) {
  for (const auto& [type, count_of_type] : {std::pair{EX_ELEM_BLOCK, EX_INQ_ELEM_BLK},
                                            {EX_EDGE_BLOCK, EX_INQ_EDGE_BLK},
                                            {EX_FACE_BLOCK, EX_INQ_FACE_BLK},
                                            {EX_NODE_SET, EX_INQ_NODE_SETS},
                                            {EX_EDGE_SET, EX_INQ_EDGE_SETS},
                                            {EX_FACE_SET, EX_INQ_FACE_SETS},
                                            {EX_SIDE_SET, EX_INQ_SIDE_SETS},
                                            {EX_ELEM_SET, EX_INQ_ELEM_SETS}}) {
    std::vector<std::int64_t> ids = file.ids(type, count_of_type);
    std::ranges::sort(ids);
    if (std::ranges::adjacent_find(ids) != ids.end())
      throw ReaderError("Exodus: two blocks or two sets have the same id");
  }
}

/// The corners of a cell of this type, as VTK's reader takes them; 0: any number.
std::int64_t corners_of(std::string_view type) {
  constexpr std::array<std::pair<std::string_view, std::int64_t>, 12> corners = {{{"TRI", 3},
                                                                                  {"QUA", 4},
                                                                                  {"TET", 4},
                                                                                  {"PYR", 5},
                                                                                  {"WED", 6},
                                                                                  {"HEX", 8},
                                                                                  {"BAR", 2},
                                                                                  {"TRU", 2},
                                                                                  {"BEA", 2},
                                                                                  {"EDG", 2},
                                                                                  {"CIR", 1},
                                                                                  {"SPH", 1}}};
  std::string start(type.substr(0, 3));
  for (char& c : start) c = static_cast<char>(std::toupper(static_cast<unsigned char>(c)));
  const auto* found = std::ranges::find(corners, start, &std::pair<std::string_view, std::int64_t>::first);
  return found == corners.end() ? 0 : found->second;
}

void read_blocks(const ExodusFile& file, ExodusHeader& header) {
  for (const std::int64_t id : file.ids(EX_ELEM_BLOCK, EX_INQ_ELEM_BLK)) {
    ex_block block{};
    block.id = id;
    block.type = EX_ELEM_BLOCK;
    const auto number = static_cast<int>(header.blocks.size());
    ExodusHeader::Block& known = header.blocks[static_cast<int>(id)];
    known.number = number;
    if (ex_get_block_param(file.id(), &block) < 0 || block.num_entry == 0) continue;
    known.type = block.topology;
    known.nodes = block.num_nodes_per_entry;
    if (known.nodes < corners_of(known.type))
      throw ReaderError(fmt::format("Exodus: block {} is damaged: cells of type {} with {} nodes", id,
                                    known.type.substr(0, 32), known.nodes));
  }
}

/// VTK's reader skips variables of cells if it finds no time steps, as in a file that leaves their number open.
void check_open_records(const ExodusHeader& header, std::uint64_t records) {
  const auto of_cells = header.values.lower_bound("vals_elem_var");
  if (of_cells == header.values.end() || !of_cells->starts_with("vals_elem_var")) return;
  throw ReaderError(fmt::format(
      "Exodus: its number of records is left open, and then VTK's reader skips variables of cells: write {} "
      "into its header (byte 4 and those that follow, the highest byte first)",
      records));
}

}  // namespace

bool ExodusHeader::has_nodal_values(int variable) const {
  return values.contains(in_one_array ? "vals_nod_var" : fmt::format("vals_nod_var{}", variable + 1));
}

bool ExodusHeader::has_element_values(int block, int variable) const {
  return values.contains(fmt::format("vals_elem_var{}eb{}", variable + 1, block + 1));
}

ExodusHeader read_exodus_header(const std::string& path) {
  ex_opts(EX_DEFAULT);  // keeps the library from printing its errors
  ExodusHeader header;
  const ExodusFile file(path);
  if (!file.is_open()) return header;
  check_ids(file);
  read_blocks(file, header);
  header.values = file.variables("vals_");
  header.in_one_array = file.has_old_model();
  header.single = file.has_single_coordinates();
  const auto records = count_open_records(path);
  if (!records) throw ReaderError(records.error().message);
  if (*records) check_open_records(header, **records);
  if (*records) header.times = file.times(static_cast<std::size_t>(**records));
  if (*records && header.times.empty()) header.values.clear();
  return header;
}

}  // namespace splatvol
