#include "player/conversion.h"

#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <utility>

#include "library/python/module/errors.h"
#include "library/python/module/interruptible_call.h"
#include "library/python/module/module.h"
#include "library/python/module/text.h"

namespace splatvol::python {
namespace {

namespace nb = nanobind;
using namespace nb::literals;

std::vector<std::string> paths_of(const std::vector<nb::bytes>& paths) {
  std::vector<std::string> names;
  for (const nb::bytes& path : paths) names.push_back(path_of(path));
  return names;
}

// A converted file, which svbuild keeps for as long as this lives, or until it is released.
class Conversion {
 public:
  explicit Conversion(ConvertedFile file) : file_(std::move(file)) {}
  Conversion(const Conversion&) = delete;
  Conversion& operator=(const Conversion&) = delete;
  ~Conversion() { release(); }

  // Waits for svbuild, which removes a temporary file.
  void release() {
    const nb::gil_scoped_release no_gil;
    file_.lease.reset();
  }

  [[nodiscard]] const ConvertedFile& file() const { return file_; }

 private:
  ConvertedFile file_;
};

Conversion* convert_inputs(const std::vector<nb::bytes>& paths, bool all_steps, const nb::bytes& svbuild,
                           const nb::object& progress) {
  ProgressBox box;
  WhileCalling meanwhile;
  if (!progress.is_none())
    meanwhile.look = [&] {
      for (const auto& [stage, share] : box.take()) progress(stage, share);
    };
  const ConversionRequest request{.inputs = paths_of(paths), .all_steps = all_steps};
  const auto tell = [&](const ConversionProgress& told) { box.put(told.stage, told.share); };
  return new Conversion(
      value_of(call_interruptibly([&] { return convert(request, tell, path_of(svbuild)); }, meanwhile)));
}

nb::list notes_of(const Conversion& conversion) {
  nb::list notes;
  for (const std::string& note : conversion.file().notes) notes.append(text_of(note));
  return notes;
}

}  // namespace

void add_conversion(nb::module_& module) {
  nb::class_<Conversion>(module, "Conversion")
      .def("path",
           [](const Conversion& conversion) {
             const std::string& path = conversion.file().path;
             return nb::bytes(path.data(), path.size());
           })
      .def("notes", &notes_of)
      .def("release", &Conversion::release);
  module.def("convert", &convert_inputs, "paths"_a, "all_steps"_a, "svbuild"_a, "progress"_a.none());
  module.def(
      "needs_conversion", [](const std::vector<nb::bytes>& paths) { return needs_conversion(paths_of(paths)); },
      "paths"_a);
  module.def("usual_svbuild", [] {
    const std::string path = usual_svbuild();
    return nb::bytes(path.data(), path.size());
  });
}

}  // namespace splatvol::python
