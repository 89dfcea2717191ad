#include "builder/sources/cgns/cgns_patches.h"

#include <vtkCellType.h>
#include <vtk_cgns.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <limits>
#include <map>
#include <span>
#include <utility>

#include "builder/sources/patch.h"
#include "builder/sources/vtk/messages.h"
#include VTK_CGNS(cgnslib.h)

namespace splatvol {
namespace {

using Name = std::array<char, 4096>;  // of a family tree; other names have 32 characters

/// A surface cell of an unstructured zone, by its number there.
struct Element {
  SurfaceCell cell;
  std::string patch;
};

/// A section of polygons: the faces of polyhedra, most of them inside the zone.
struct PolygonSection {
  cgsize_t first = 0, last = 0;           // numbers of its polygons
  std::vector<cgsize_t> points, offsets;  // points of polygon i: from offsets[i] to offsets[i + 1]
};

int vtk_type_of(CGNS_ENUMT(ElementType_t) type) {
  switch (type) {
    case CGNS_ENUMV(TRI_3):
      return VTK_TRIANGLE;
    case CGNS_ENUMV(QUAD_4):
      return VTK_QUAD;
    case CGNS_ENUMV(TRI_6):
      return VTK_QUADRATIC_TRIANGLE;
    case CGNS_ENUMV(QUAD_8):
      return VTK_QUADRATIC_QUAD;
    case CGNS_ENUMV(QUAD_9):
      return VTK_BIQUADRATIC_QUAD;
    default:
      return VTK_EMPTY_CELL;
  }
}

/// Reads the patches of one zone.
class ZoneReader {
 public:
  ZoneReader(int file, int base, int zone) : file_(file), base_(base), zone_(zone) {}

  void read(std::map<std::string, TriangleMesh>& patches) {
    Name name{};
    if (cg_zone_read(file_, base_, zone_, name.data(), size_.data()) != CG_OK ||
        cg_zone_type(file_, base_, zone_, &type_) != CG_OK)
      return;
    const bool is_structured = type_ == CGNS_ENUMV(Structured);
    if (!is_structured && type_ != CGNS_ENUMV(Unstructured)) return;
    if (!is_structured) read_sections();
    int conditions = 0;
    cg_nbocos(file_, base_, zone_, &conditions);
    for (int condition = 1; condition <= conditions; ++condition) read_condition(condition);
    for (auto& [number, element] : elements_) cells_[element.patch].push_back(std::move(element.cell));
    if (cells_.empty() || !read_points()) return;
    for (auto& [patch, cells] : cells_) append_cells_of(points_, std::move(cells), patches[patch]);
  }

 private:
  /// Returns 0 if there are more than 2^32 - 1.
  [[nodiscard]] std::uint64_t point_count() const {
    constexpr std::uint64_t most = std::numeric_limits<std::uint32_t>::max();
    const std::size_t axes = type_ == CGNS_ENUMV(Structured) ? 3 : 1;
    std::uint64_t count = 1;
    for (std::size_t axis = 0; axis < axes; ++axis) {
      const auto size = static_cast<std::uint64_t>(std::max<cgsize_t>(size_[axis], 0));
      if (size == 0 || size > most / count) return 0;
      count *= size;
    }
    return count;
  }

  /// Reads the sections of surface cells of one type, the surface cells of mixed ones, and polygons.
  void read_sections() {
    int sections = 0;
    cg_nsections(file_, base_, zone_, &sections);
    for (int section = 1; section <= sections; ++section) {
      Name name{};
      CGNS_ENUMT(ElementType_t) type{};
      cgsize_t first = 0, last = 0, size = 0;
      int border = 0, has_parents = 0;
      if (cg_section_read(file_, base_, zone_, section, name.data(), &type, &first, &last, &border, &has_parents) !=
              CG_OK ||
          cg_ElementDataSize(file_, base_, zone_, section, &size) != CG_OK || first < 1 || last < first ||
          last - first >= size || last == std::numeric_limits<cgsize_t>::max())
        continue;
      const bool is_polygons = type == CGNS_ENUMV(NGON_n), has_offsets = is_polygons || type == CGNS_ENUMV(MIXED);
      if (!has_offsets && vtk_type_of(type) == VTK_EMPTY_CELL) continue;
      std::vector<cgsize_t> points(static_cast<std::size_t>(size));
      std::vector<cgsize_t> offsets(has_offsets ? static_cast<std::size_t>(last - first) + 2 : 0);
      const int read = has_offsets
                           ? cg_poly_elements_read(file_, base_, zone_, section, points.data(), offsets.data(), nullptr)
                           : cg_elements_read(file_, base_, zone_, section, points.data(), nullptr);
      if (read != CG_OK) continue;
      if (is_polygons)
        polygons_.push_back({first, last, std::move(points), std::move(offsets)});
      else
        add_elements(name.data(), type, first, points);
    }
  }

  void add_elements(const std::string& section, CGNS_ENUMT(ElementType_t) type, cgsize_t number,
                    std::span<const cgsize_t> points) {
    while (!points.empty()) {
      CGNS_ENUMT(ElementType_t) own = type;
      if (type == CGNS_ENUMV(MIXED)) {
        own = static_cast<CGNS_ENUMT(ElementType_t)>(points.front());
        points = points.subspan(1);
      }
      int count = 0;
      if (cg_npe(own, &count) != CG_OK || count <= 0 || static_cast<std::size_t>(count) > points.size()) return;
      if (vtk_type_of(own) != VTK_EMPTY_CELL) {
        SurfaceCell cell{vtk_type_of(own), {}};
        for (const cgsize_t point : points.first(static_cast<std::size_t>(count)))
          cell.points.push_back(static_cast<std::uint32_t>(point - 1));
        elements_[number] = {std::move(cell), section};
      }
      ++number;
      points = points.subspan(static_cast<std::size_t>(count));
    }
  }

  void read_condition(int condition) {
    Name name{}, family{};
    CGNS_ENUMT(BCType_t) type{};
    CGNS_ENUMT(PointSetType_t) set{};
    CGNS_ENUMT(GridLocation_t) location{};
    CGNS_ENUMT(DataType_t) normal_type{};
    cgsize_t count = 0, normals = 0;
    std::array<int, 3> normal{};
    int data_sets = 0;
    if (cg_boco_info(file_, base_, zone_, condition, name.data(), &type, &set, &count, normal.data(), &normals,
                     &normal_type, &data_sets) != CG_OK ||
        cg_boco_gridlocation_read(file_, base_, zone_, condition, &location) != CG_OK || count <= 0)
      return;
    const int axes = type_ == CGNS_ENUMV(Structured) ? 3 : 1;
    std::vector<cgsize_t> numbers(static_cast<std::size_t>(count) * static_cast<std::size_t>(axes));
    if (cg_boco_read(file_, base_, zone_, condition, numbers.data(), nullptr) != CG_OK) return;
    std::string patch = name.data();
    if (cg_goto(file_, base_, "Zone_t", zone_, "ZoneBC_t", 1, "BC_t", condition, "end") == CG_OK &&
        cg_famname_read(family.data()) == CG_OK)
      patch = family.data();
    const bool is_range = set == CGNS_ENUMV(PointRange) || set == CGNS_ENUMV(ElementRange);
    if (axes == 3) {
      if (is_range && count == 2 && location == CGNS_ENUMV(Vertex)) add_range(patch, numbers);
      return;
    }
    const bool of_elements =
        set == CGNS_ENUMV(ElementRange) || set == CGNS_ENUMV(ElementList) || location == CGNS_ENUMV(FaceCenter);
    if (!of_elements) return;
    if (!is_range) {
      for (const cgsize_t number : numbers) assign(number, patch);
      return;
    }
    if (count != 2) return;
    const auto [low, high] = std::minmax(numbers[0], numbers[1]);
    for (auto at = elements_.lower_bound(low); at != elements_.end() && at->first <= high; ++at)
      at->second.patch = patch;
    for (const PolygonSection& section : polygons_)
      for (cgsize_t number = std::max(low, section.first); number <= std::min(high, section.last); ++number)
        assign(number, patch);
  }

  /// Gives a surface cell to a patch. A polygon has none before.
  void assign(cgsize_t number, const std::string& patch) {
    if (const auto found = elements_.find(number); found != elements_.end()) {
      found->second.patch = patch;
      return;
    }
    for (const PolygonSection& section : polygons_) {
      if (number < section.first || number > section.last) continue;
      const auto index = static_cast<std::size_t>(number - section.first);
      const cgsize_t begin = section.offsets[index], end = section.offsets[index + 1];
      if (begin < 0 || end < begin || end - begin < 3 || static_cast<std::size_t>(end) > section.points.size())
        continue;
      Element& element = elements_[number] = {{VTK_POLYGON, {}}, patch};
      for (cgsize_t at = begin; at < end; ++at)
        element.cell.points.push_back(static_cast<std::uint32_t>(section.points[static_cast<std::size_t>(at)] - 1));
    }
  }

  /// Adds the quadrilaterals between the points of a structured zone from one corner to another.
  void add_range(const std::string& patch, std::span<const cgsize_t> corners) {
    std::array<cgsize_t, 3> low{}, high{};
    int flat = -1;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      low[axis] = std::min(corners[axis], corners[axis + 3]) - 1;
      high[axis] = std::max(corners[axis], corners[axis + 3]) - 1;
      if (low[axis] < 0 || high[axis] >= size_[axis]) return;
      if (low[axis] == high[axis]) flat = flat < 0 ? static_cast<int>(axis) : 3;
    }
    if (flat < 0 || flat > 2 || point_count() == 0) return;
    const auto u = static_cast<std::size_t>((flat + 1) % 3), v = static_cast<std::size_t>((flat + 2) % 3);
    const std::array<cgsize_t, 3> stride = {1, size_[0], size_[0] * size_[1]};
    for (cgsize_t j = low[v]; j < high[v]; ++j)
      for (cgsize_t i = low[u]; i < high[u]; ++i) {
        const cgsize_t a = low[static_cast<std::size_t>(flat)] * stride[static_cast<std::size_t>(flat)] +
                           i * stride[u] + j * stride[v];
        SurfaceCell cell{VTK_QUAD, {}};
        for (const cgsize_t point : {a, a + stride[u], a + stride[u] + stride[v], a + stride[v]})
          cell.points.push_back(static_cast<std::uint32_t>(point));
        cells_[patch].push_back(std::move(cell));
      }
  }

  /// Reads the coordinates as VTK's reader does: in double precision.
  bool read_points() {
    const std::uint64_t count = point_count();
    if (count == 0) return false;
    points_.resize(count);
    const std::array<cgsize_t, 3> first = {1, 1, 1};
    std::vector<double> values(count);
    constexpr std::array<const char*, 3> axes = {"CoordinateX", "CoordinateY", "CoordinateZ"};
    for (int axis = 0; axis < 3; ++axis) {
      if (cg_coord_read(file_, base_, zone_, axes[static_cast<std::size_t>(axis)], CGNS_ENUMV(RealDouble), first.data(),
                        size_.data(), values.data()) != CG_OK)
        return false;
      for (std::size_t i = 0; i < count; ++i) points_[i][axis] = values[i];
    }
    return true;
  }

  int file_, base_, zone_;
  CGNS_ENUMT(ZoneType_t) type_{};
  std::array<cgsize_t, 9> size_{};
  std::map<cgsize_t, Element> elements_;  // by their numbers; polygons of conditions only
  std::vector<PolygonSection> polygons_;
  std::map<std::string, std::vector<SurfaceCell>> cells_;  // of each patch
  std::vector<dvec3> points_;
};

}  // namespace

std::vector<Patch> read_cgns_patches(const std::string& path) {
  int file = 0, bases = 0;
  if (cg_open(path.c_str(), CG_MODE_READ, &file) != CG_OK) throw ReaderError("CGNS: {}", cg_get_error());
  std::map<std::string, TriangleMesh> patches;
  cg_nbases(file, &bases);
  for (int base = 1; base <= bases; ++base) {
    Name name{};
    int cell_dimension = 0, dimension = 0, zones = 0;
    if (cg_base_read(file, base, name.data(), &cell_dimension, &dimension) != CG_OK || cell_dimension != 3) continue;
    cg_nzones(file, base, &zones);
    for (int zone = 1; zone <= zones; ++zone) ZoneReader(file, base, zone).read(patches);
  }
  cg_close(file);
  std::vector<Patch> all;
  for (auto& [name, mesh] : patches) all.push_back({name, std::move(mesh)});
  return all;
}

}  // namespace splatvol
