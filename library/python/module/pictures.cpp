#include <nanobind/stl/array.h>
#include <nanobind/stl/map.h>
#include <nanobind/stl/string.h>

#include <cstring>

#include "library/python/module/arrays.h"
#include "library/python/module/errors.h"
#include "library/python/module/interruptible_call.h"
#include "library/python/module/module.h"
#include "library/python/module/text.h"
#include "splatvol/image.h"
#include "splatvol/scene.h"

namespace splatvol::python {
namespace {

namespace nb = nanobind;
using namespace nb::literals;

using Picture = nb::ndarray<const float, nb::shape<-1, -1, 4>, nb::c_contig, nb::device::cpu>;

void write_picture(const nb::bytes& path, const Picture& picture, const std::array<double, 3>& background,
                   const Provenance& provenance, bool transparent) {
  Image image{static_cast<int>(picture.shape(1)), static_cast<int>(picture.shape(0)), {}};
  image.pixels.resize(picture.shape(0) * picture.shape(1));
  std::memcpy(image.pixels.data(), picture.data(), image.pixels.size() * sizeof(vec4));
  const std::string name = path_of(path);
  const dvec3 behind(background[0], background[1], background[2]);
  value_of(call_interruptibly([&] { return write_image(name, image, behind, provenance, transparent); }));
}

}  // namespace

void add_pictures(nb::module_& module) {
  module.def("write_picture", &write_picture, "path"_a, "picture"_a.noconvert(), "background"_a, "provenance"_a,
             "transparent"_a);
  module.def(
      "check_scene", [](const std::string& json) { return scene_to_json(value_of(parse_scene(json))); }, "json"_a);
}

}  // namespace splatvol::python
