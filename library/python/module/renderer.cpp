#include "splatvol/renderer.h"

#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

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

using Depths = nb::ndarray<const float, nb::ndim<2>, nb::c_contig, nb::device::cpu>;

OutArray<float> picture_of(Image image) {
  const auto height = static_cast<std::size_t>(image.height), width = static_cast<std::size_t>(image.width);
  return take<float>(std::move(image.pixels), {height, width, 4});
}

// A renderer whose calls let other threads of Python run. The package makes sure that calls do not overlap.
class SharedRenderer {
 public:
  SharedRenderer(const nb::bytes& path, std::uint64_t memory)
      : renderer_(value_of(call_interruptibly(
            [name = path_of(path), memory] { return Renderer::open(name, std::nullopt, {.memory = memory}); }))) {}
  SharedRenderer(const SharedRenderer&) = delete;
  SharedRenderer& operator=(const SharedRenderer&) = delete;

  ~SharedRenderer() {
    // Waits for threads that read.
    const nb::gil_scoped_release no_gil;
    renderer_.reset();
  }

  template <class Call>
  auto run(Call call) {
    return value_of(call_interruptibly([&] { return call(*renderer_); }, {.cancel = [this] { renderer_->cancel(); }}));
  }

  [[nodiscard]] const Renderer& get() const { return *renderer_; }

 private:
  std::optional<Renderer> renderer_;
};

void set_scene(SharedRenderer& renderer, const std::string& json) {
  const Scene scene = value_of(parse_scene(json));
  renderer.run([&](Renderer& opened) { return opened.set_scene(scene); });
}

std::string fitting_scene(SharedRenderer& renderer, const std::string& attribute, int width, int height) {
  return scene_to_json(renderer.run([&](Renderer& opened) { return opened.fitting_scene(attribute, width, height); }));
}

void set_surface_depths(SharedRenderer& renderer, const std::optional<Depths>& depths) {
  std::optional<SurfaceDepths> surfaces;
  if (depths)
    surfaces = SurfaceDepths{static_cast<int>(depths->shape(1)),
                             static_cast<int>(depths->shape(0)),
                             {depths->data(), depths->data() + depths->size()}};
  renderer.run([&](Renderer& opened) { return opened.set_surface_depths(std::move(surfaces)); });
}

nb::dict statistics_of(const SharedRenderer& renderer) {
  const RenderStatistics& statistics = renderer.get().statistics();
  nb::list unreadable;
  for (const Error& error : statistics.unreadable) unreadable.append(text_of(error.message));
  return dict_of("splats", statistics.splats, "error", statistics.error, "is_complete", statistics.is_complete,
                 "is_settled", statistics.is_settled, "missing_bytes", statistics.missing_bytes, "bytes_read",
                 statistics.bytes_read, "bytes_held", statistics.bytes_held, "requests", statistics.requests, "seconds",
                 statistics.seconds, "unreadable", unreadable);
}

}  // namespace

void add_renderer(nb::module_& module) {
  nb::class_<Quality>(module, "Quality")
      .def(
          "__init__",
          [](Quality* self, std::optional<double> max_error, std::optional<std::uint64_t> splats,
             std::optional<double> tolerance, std::optional<std::size_t> resolution, std::optional<bool> exact,
             std::optional<double> milliseconds) {
            new (self) Quality{max_error, splats, tolerance, resolution, exact.value_or(false), milliseconds};
          },
          nb::kw_only(), "max_error"_a = nb::none(), "splats"_a = nb::none(), "tolerance"_a = nb::none(),
          "resolution"_a = nb::none(), "exact"_a = nb::none(), "milliseconds"_a = nb::none());

  nb::class_<SharedRenderer>(module, "Renderer")
      .def(nb::init<const nb::bytes&, std::uint64_t>(), "path"_a, "memory"_a)
      .def("set_scene", &set_scene, "json"_a)
      .def("scene", [](const SharedRenderer& renderer) { return scene_to_json(renderer.get().scene()); })
      .def("fitting_scene", &fitting_scene, "attribute"_a, "width"_a, "height"_a)
      .def("set_surface_depths", &set_surface_depths, "depths"_a.none().noconvert())
      .def("step", [](const SharedRenderer& renderer) { return renderer.get().step(); })
      .def(
          "show_step",
          [](SharedRenderer& renderer, std::size_t step) {
            renderer.run([&](Renderer& opened) { return opened.show_step(step); });
          },
          "step"_a)
      .def(
          "render",
          [](SharedRenderer& renderer, const Quality& quality) {
            return picture_of(renderer.run([&](Renderer& opened) { return opened.render(quality); }));
          },
          "quality"_a)
      .def(
          "render_now",
          [](SharedRenderer& renderer, double wait_seconds, const Quality& quality) {
            return picture_of(renderer.run([&](Renderer& opened) { return opened.render_now(wait_seconds, quality); }));
          },
          "wait_seconds"_a, "quality"_a)
      .def("statistics", &statistics_of)
      .def("device", [](const SharedRenderer& renderer) { return renderer.get().device(); });
}

}  // namespace splatvol::python
