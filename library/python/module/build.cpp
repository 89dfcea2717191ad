#include "splatvol/build.h"

#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <utility>

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

using Indices = nb::ndarray<const std::int64_t, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Types = nb::ndarray<const std::uint8_t, nb::ndim<1>, nb::c_contig, nb::device::cpu>;

Numbers numbers_of(const InArray& array) {
  if (array.dtype() == nb::dtype<double>()) return std::span(static_cast<const double*>(array.data()), array.size());
  if (array.dtype() == nb::dtype<float>()) return std::span(static_cast<const float*>(array.data()), array.size());
  raise({ErrorCode::invalid_argument, "numbers must be float32 or float64"});
}

template <class Array>
auto span_of(const Array& array) {
  return std::span(array.data(), array.size());
}

// Values at points or in cells, as the package hands them over.
struct NamedValues {
  std::string name;
  InArray values;
  std::string unit;

  [[nodiscard]] ValueArray array() const {
    return {name, numbers_of(values), values.ndim() == 2 ? static_cast<int>(values.shape(1)) : 1, unit};
  }
};

std::vector<ValueArray> arrays_of(const std::vector<NamedValues>& values) {
  std::vector<ValueArray> arrays;
  for (const NamedValues& one : values) arrays.push_back(one.array());
  return arrays;
}

// A mesh whose arrays are held by Python.
struct Mesh {
  InArray points;
  Indices connectivity, offsets;
  Types types;
  Indices faces, face_locations;
  std::vector<NamedValues> point_values, cell_values;

  [[nodiscard]] MeshArrays arrays() const {
    return {.points = numbers_of(points),
            .connectivity = span_of(connectivity),
            .offsets = span_of(offsets),
            .types = span_of(types),
            .faces = span_of(faces),
            .face_locations = span_of(face_locations),
            .point_values = arrays_of(point_values),
            .cell_values = arrays_of(cell_values)};
  }
};

// A step whose arrays are held by Python.
struct Step {
  double time;
  std::vector<NamedValues> point_values, cell_values;

  [[nodiscard]] MeshStep arrays() const { return {time, arrays_of(point_values), arrays_of(cell_values)}; }
};

nb::dict report_of(const MeshBuildReport& report) {
  return dict_of("resolution_counts", report.resolution_counts, "file_bytes", report.file_bytes, "connectivity",
                 report.connectivity, "census", report.census, "warnings", report.warnings, "conversions",
                 report.conversions, "kept_cells", report.kept_cells);
}

// Runs write(options), which tells its progress.
template <class Write>
nb::dict run_build(MeshBuildOptions options, const nb::object& progress, Write write) {
  ProgressBox box;
  WhileCalling meanwhile;
  options.progress = [&](const char* stage, double share) { box.put(stage, share); };
  if (!progress.is_none())
    meanwhile.look = [&] {
      for (const auto& [stage, share] : box.take()) progress(stage, share);
    };
  return report_of(value_of(call_interruptibly([&] { return write(options); }, meanwhile)));
}

nb::dict build_file(const Mesh& mesh, const nb::bytes& path, const MeshBuildOptions& options,
                    const nb::object& progress) {
  return run_build(options, progress, [arrays = mesh.arrays(), output = path_of(path)](const MeshBuildOptions& chosen) {
    return build(arrays, output, chosen);
  });
}

nb::dict build_steps(const Mesh& mesh, const std::vector<Step>& steps, const nb::bytes& path,
                     const MeshBuildOptions& options, bool append, const nb::object& progress) {
  std::vector<MeshStep> arrays;
  for (const Step& step : steps) arrays.push_back(step.arrays());
  return run_build(options, progress,
                   [&, shared = mesh.arrays(), output = path_of(path)](const MeshBuildOptions& chosen) {
                     return (append ? append_to_series : build_series)(shared, arrays, output, chosen);
                   });
}

}  // namespace

void add_build(nb::module_& module) {
  nb::class_<NamedValues>(module, "NamedValues")
      .def(
          "__init__",
          [](NamedValues* self, const std::string& name, InArray values, const std::string& unit) {
            new (self) NamedValues{name, std::move(values), unit};
          },
          "name"_a, "values"_a.noconvert(), "unit"_a);

  nb::class_<Mesh>(module, "Mesh")
      .def(
          "__init__",
          [](Mesh* self, InArray points, Indices connectivity, Indices offsets, Types types, Indices faces,
             Indices face_locations, std::vector<NamedValues> point_values, std::vector<NamedValues> cell_values) {
            new (self)
                Mesh{std::move(points), std::move(connectivity),   std::move(offsets),      std::move(types),
                     std::move(faces),  std::move(face_locations), std::move(point_values), std::move(cell_values)};
          },
          "points"_a.noconvert(), "connectivity"_a.noconvert(), "offsets"_a.noconvert(), "types"_a.noconvert(),
          "faces"_a.noconvert(), "face_locations"_a.noconvert(), "point_values"_a, "cell_values"_a);

  nb::class_<Step>(module, "Step")
      .def(
          "__init__",
          [](Step* self, double time, std::vector<NamedValues> point_values, std::vector<NamedValues> cell_values) {
            new (self) Step{time, std::move(point_values), std::move(cell_values)};
          },
          "time"_a, "point_values"_a, "cell_values"_a);

  nb::class_<MeshBuildOptions>(module, "BuildOptions")
      .def(nb::init<>())
      .def_rw("own_cells", &MeshBuildOptions::own_cells)
      .def_rw("connectivity", &MeshBuildOptions::connectivity)
      .def_rw("reduction", &MeshBuildOptions::reduction)
      .def_rw("missing", &MeshBuildOptions::missing)
      .def_rw("exact", &MeshBuildOptions::exact)
      .def_rw("strict", &MeshBuildOptions::strict)
      .def_rw("memory", &MeshBuildOptions::memory)
      .def_rw("temp_folder", &MeshBuildOptions::temp_folder)
      .def_rw("name", &MeshBuildOptions::name)
      .def_rw("boundary_triangles", &MeshBuildOptions::boundary_triangles)
      .def_rw("keep_cells", &MeshBuildOptions::keep_cells)
      .def_prop_rw(
          "up", [](const MeshBuildOptions& o) { return o.up == 0 ? std::string() : std::string(1, o.up); },
          [](MeshBuildOptions& o, const std::string& up) { o.up = up.empty() ? '\0' : up[0]; });

  module.def("build", &build_file, "mesh"_a, "path"_a, "options"_a, "progress"_a.none());
  module.def("build_series", &build_steps, "mesh"_a, "steps"_a, "path"_a, "options"_a, "append"_a, "progress"_a.none());
}

}  // namespace splatvol::python
