#include "splatvol/file.h"

#include <nanobind/stl/array.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <shared_mutex>
#include <span>
#include <tuple>

#include "library/python/module/arrays.h"
#include "library/python/module/dicts.h"
#include "library/python/module/errors.h"
#include "library/python/module/interruptible_call.h"
#include "library/python/module/module.h"
#include "library/python/module/text.h"

namespace splatvol::python {
namespace {

namespace nb = nanobind;
using namespace nb::literals;

using AttributeRow = std::tuple<std::string, std::string, double, double, std::uint64_t, double>;

using Corner = std::tuple<double, double, double>;

using Positions = nb::ndarray<const double, nb::shape<-1, 3>, nb::c_contig>;

std::span<const dvec3> span_of(const Positions& positions) {
  static_assert(sizeof(dvec3) == 3 * sizeof(double));
  return {reinterpret_cast<const dvec3*>(positions.data()), positions.shape(0)};
}

dvec3 vector_of(const Corner& p) { return {std::get<0>(p), std::get<1>(p), std::get<2>(p)}; }
Corner corner_of(const dvec3& p) { return {p.x, p.y, p.z}; }

// A file for several threads: changing the step waits for reads.
class SharedFile {
 public:
  explicit SharedFile(File file) : file_(std::move(file)) {}

  template <class Call>
  auto read(Call call, const WhileCalling& meanwhile = {}) const {
    return value_of(call_interruptibly(
        [&] {
          const std::shared_lock lock(mutex_);
          return call(file_);
        },
        meanwhile));
  }

  void show_step(std::size_t step) {
    value_of(call_interruptibly([&] {
      const std::unique_lock lock(mutex_);
      return file_.show_step(step);
    }));
  }

  // For calls that read nothing. Their lock needs no GIL to be released.
  template <class Call>
  auto look(Call call) const {
    const std::shared_lock lock(mutex_);
    return call(file_);
  }

 private:
  mutable std::shared_mutex mutex_;
  File file_;
};

std::vector<AttributeRow> attributes_of(const File& file) {
  std::vector<AttributeRow> rows;
  for (const Attribute& a : file.attributes()) rows.emplace_back(a.name, a.unit, a.low, a.high, a.missing, a.error);
  return rows;
}

nb::list lists_of(std::vector<std::vector<double>> columns) {
  nb::list list;
  for (std::vector<double>& column : columns) list.append(take(std::move(column)));
  return list;
}

nb::dict points_of(Points points, bool material) {
  nb::dict dict;
  dict["resolution"] = points.resolution;
  dict["names"] = points.names;
  dict["positions"] = take(std::move(points.positions));
  dict["values"] = lists_of(std::move(points.values));
  if (!material) return dict;
  const std::size_t count = points.covariances.size();
  dict["volumes"] = take(std::move(points.volumes));
  dict["centroids"] = take(std::move(points.centroids));
  dict["covariances"] = take<double>(std::move(points.covariances), {count, 6});
  dict["means"] = lists_of(std::move(points.means));
  dict["deviations"] = lists_of(std::move(points.deviations));
  return dict;
}

nb::dict read_points(const SharedFile& file, std::optional<std::size_t> resolution,
                     std::optional<std::uint64_t> max_points, const std::vector<std::string>& attributes,
                     const std::optional<std::pair<Corner, Corner>>& box, bool material) {
  PointsRequest request{.resolution = resolution, .attributes = attributes, .material = material};
  if (max_points) request.max_points = *max_points;
  if (box) request.box = Box{vector_of(box->first), vector_of(box->second)};
  return points_of(file.read([&](const File& opened) { return opened.points(request); }), material);
}

OutArray<double> sample(const SharedFile& file, const Positions& positions, const std::string& attribute,
                        std::optional<std::size_t> resolution) {
  const std::span<const dvec3> where = span_of(positions);
  return take(file.read([&](const File& opened) { return opened.sample(where, attribute, resolution); }));
}

// [name, numbers]: (n,), or (n, k) of a vector.
nb::list arrays_of(std::vector<MeshValues> arrays) {
  nb::list list;
  for (MeshValues& array : arrays) {
    const std::size_t rows = array.numbers.size() / array.components;
    list.append(nb::make_tuple(array.name, array.components == 1
                                               ? take(std::move(array.numbers))
                                               : take<double>(std::move(array.numbers), {rows, array.components})));
  }
  return list;
}

MeshRequest mesh_request(const std::vector<std::string>& attributes,
                         const std::optional<std::pair<Corner, Corner>>& box) {
  MeshRequest request{.attributes = attributes};
  if (box) request.box = Box{vector_of(box->first), vector_of(box->second)};
  return request;
}

nb::dict read_cells(const SharedFile& file, const std::vector<std::string>& attributes,
                    const std::optional<std::pair<Corner, Corner>>& box) {
  CellMesh mesh = file.read([&](const File& opened) { return opened.cells(mesh_request(attributes, box)); });
  return dict_of("points", take(std::move(mesh.points)), "connectivity", take(std::move(mesh.connectivity)), "offsets",
                 take(std::move(mesh.offsets)), "types", take(std::move(mesh.types)), "point_values",
                 arrays_of(std::move(mesh.point_values)), "cell_values", arrays_of(std::move(mesh.cell_values)),
                 "left_out", mesh.left_out, "split", mesh.split);
}

nb::dict read_contour(const SharedFile& file, double value, const std::string& attribute,
                      const std::vector<std::string>& attributes, const std::optional<std::pair<Corner, Corner>>& box) {
  ContourMesh mesh =
      file.read([&](const File& opened) { return opened.contour(value, attribute, mesh_request(attributes, box)); });
  const std::size_t triangles = mesh.triangles.size();
  return dict_of("points", take(std::move(mesh.points)), "triangles",
                 take<std::int64_t>(std::move(mesh.triangles), {triangles, 3}), "point_values",
                 arrays_of(std::move(mesh.point_values)), "left_out", mesh.left_out);
}

using PlaneRow = std::pair<Corner, Corner>;                // point, normal
using RangeRow = std::tuple<std::string, double, double>;  // attribute, low, high

IntegralRequest integral_request(const std::vector<std::string>& attributes,
                                 const std::optional<std::pair<Corner, Corner>>& box,
                                 const std::vector<PlaneRow>& clip_planes, const std::vector<RangeRow>& ranges) {
  IntegralRequest request{.attributes = attributes};
  if (box) request.box = Box{vector_of(box->first), vector_of(box->second)};
  for (const auto& [point, normal] : clip_planes) request.clip_planes.push_back({vector_of(point), vector_of(normal)});
  for (const auto& [attribute, low, high] : ranges) request.ranges.push_back({attribute, low, high});
  return request;
}

nb::dict dict_of_integral(const ValueIntegral& of) {
  return dict_of("name", of.name, "unit", of.unit, "integral", of.integral, "mean", of.mean, "low", of.low,
                 "low_position", corner_of(of.low_position), "high", of.high, "high_position",
                 corner_of(of.high_position));
}

nb::dict integrate(const SharedFile& file, const std::vector<std::string>& attributes,
                   const std::optional<std::pair<Corner, Corner>>& box, const std::vector<PlaneRow>& clip_planes,
                   const std::vector<RangeRow>& ranges) {
  const IntegralRequest request = integral_request(attributes, box, clip_planes, ranges);
  const Integrals integrals = file.read([&](const File& opened) { return opened.integrate(request); });
  nb::list rows;
  for (const Integral& of : integrals.attributes) {
    nb::dict row = dict_of_integral(of);
    row["volume"] = of.volume;
    row["missing_volume"] = of.missing_volume;
    rows.append(row);
  }
  return dict_of("volume", integrals.volume, "unknown_volume", integrals.unknown_volume, "attributes", rows, "left_out",
                 integrals.left_out);
}

// Of a contour, or of the slice by a plane.
nb::dict integrate_surface(const SharedFile& file, const std::optional<std::pair<std::string, double>>& contour,
                           const std::optional<PlaneRow>& slice, const std::vector<std::string>& attributes,
                           const std::optional<std::pair<Corner, Corner>>& box,
                           const std::vector<PlaneRow>& clip_planes, const std::vector<RangeRow>& ranges,
                           const std::array<std::string, 3>& vector) {
  SurfaceRequest request{.integrals = integral_request(attributes, box, clip_planes, ranges), .vector = vector};
  if (contour) request.surface = ContourSurface{contour->first, contour->second};
  if (slice) request.surface = HalfSpace{vector_of(slice->first), vector_of(slice->second)};
  const SurfaceIntegrals integrals = file.read([&](const File& opened) { return opened.integrate_surface(request); });
  nb::list rows;
  for (const SurfaceIntegral& of : integrals.attributes) {
    nb::dict row = dict_of_integral(of);
    row["area"] = of.area;
    row["missing_area"] = of.missing_area;
    rows.append(row);
  }
  return dict_of("area", integrals.area, "unknown_area", integrals.unknown_area, "attributes", rows, "flux",
                 integrals.flux, "enclosed_volume", integrals.enclosed_volume, "left_out", integrals.left_out);
}

nb::dict sample_line(const SharedFile& file, const Corner& start, const Corner& end,
                     const std::vector<std::string>& attributes, std::optional<std::size_t> samples) {
  LineSamples line = file.read(
      [&](const File& opened) { return opened.sample_line(vector_of(start), vector_of(end), attributes, samples); });
  nb::dict dict;
  dict["names"] = line.names;
  dict["arc_lengths"] = take(std::move(line.arc_lengths));
  dict["positions"] = take(std::move(line.positions));
  dict["values"] = lists_of(std::move(line.values));
  return dict;
}

// [seed, positions, times, values, begin, end] of each line. `patch`: instead of seeds, with `count` on it.
std::pair<std::vector<std::string>, nb::list> streamlines(const SharedFile& file, const std::string& vector,
                                                          const Positions& seeds,
                                                          const std::optional<std::string>& patch, std::size_t count,
                                                          const std::vector<std::string>& attributes, int direction,
                                                          std::optional<double> max_length, std::size_t max_steps) {
  StreamlineRequest request{.vector = vector,
                            .attributes = attributes,
                            .direction = static_cast<StreamlineDirection>(direction),
                            .max_length = max_length,
                            .max_steps = max_steps};
  const std::span<const dvec3> positions = span_of(seeds);
  request.seeds = std::vector(positions.begin(), positions.end());
  if (patch) request.seeds = SeedPatch{*patch, count};
  Streamlines found = file.read([&](const File& opened) { return opened.streamlines(request); });
  nb::list rows;
  for (Streamline& line : found.lines)
    rows.append(nb::make_tuple(line.seed, take(std::move(line.positions)), take(std::move(line.times)),
                               lists_of(std::move(line.values)), name_of(line.begin), name_of(line.end)));
  return {std::move(found.names), rows};
}

void verify(const SharedFile& file, const nb::object& progress) {
  ProgressBox box;
  WhileCalling meanwhile;
  if (!progress.is_none())
    meanwhile.look = [&] {
      for (const auto& [stage, share] : box.take()) progress(share);
    };
  file.read([&](const File& opened) { return opened.verify([&](double share) { box.put("", share); }); }, meanwhile);
}

}  // namespace

void add_file(nb::module_& module) {
  nb::class_<SharedFile>(module, "File")
      .def("__init__",
           [](SharedFile* self, const nb::bytes& path) {
             const std::string name = path_of(path);
             new (self) SharedFile(value_of(call_interruptibly([&] { return File::open(name); })));
           })
      .def("name", [](const SharedFile& file) { return file.look([](const File& f) { return text_of(f.name()); }); })
      .def("attributes", [](const SharedFile& file) { return file.look(attributes_of); })
      .def("resolution_counts",
           [](const SharedFile& file) { return file.look([](const File& f) { return f.resolution_counts(); }); })
      .def("bounds",
           [](const SharedFile& file) {
             const Box box = file.look([](const File& f) { return f.bounds(); });
             return std::pair(corner_of(box.low), corner_of(box.high));
           })
      .def("times", [](const SharedFile& file) { return file.look([](const File& f) { return f.times(); }); })
      .def("step", [](const SharedFile& file) { return file.look([](const File& f) { return f.step(); }); })
      .def(
          "nearest_step",
          [](const SharedFile& file, double time) {
            return file.look([&](const File& f) { return f.nearest_step(time); });
          },
          "time"_a)
      .def(
          "range_of",
          [](const SharedFile& file, const std::string& attribute) {
            return file.look([&](const File& f) { return f.range_of(attribute); });
          },
          "attribute"_a)
      .def("show_step", &SharedFile::show_step, "step"_a)
      .def("points", &read_points, "resolution"_a.none(), "max_points"_a.none(), "attributes"_a, "box"_a.none(),
           "material"_a)
      .def("sample", &sample, "positions"_a.noconvert(), "attribute"_a, "resolution"_a.none())
      .def("sample_line", &sample_line, "start"_a, "end"_a, "attributes"_a, "samples"_a.none())
      .def("cells", &read_cells, "attributes"_a, "box"_a.none())
      .def("contour", &read_contour, "value"_a, "attribute"_a, "attributes"_a, "box"_a.none())
      .def("integrate", &integrate, "attributes"_a, "box"_a.none(), "clip_planes"_a, "ranges"_a)
      .def("integrate_surface", &integrate_surface, "contour"_a.none(), "slice"_a.none(), "attributes"_a,
           "box"_a.none(), "clip_planes"_a, "ranges"_a, "vector"_a)
      .def("streamlines", &streamlines, "vector"_a, "seeds"_a.noconvert(), "patch"_a.none(), "count"_a, "attributes"_a,
           "direction"_a, "max_length"_a.none(), "max_steps"_a)
      .def("verify", &verify, "progress"_a.none())
      .def("file_bytes", [](const SharedFile& file) { return file.look([](const File& f) { return f.file_bytes(); }); })
      .def("bytes_read",
           [](const SharedFile& file) { return file.look([](const File& f) { return f.bytes_read(); }); });
}

}  // namespace splatvol::python
