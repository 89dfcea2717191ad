#include "tests/support/openfoam_files.h"

#include <fmt/format.h>
#include <zlib.h>

#include <algorithm>
#include <cstdint>

namespace splatvol::test {
namespace {

/// Texts of lists in a layout.
class Writer {
 public:
  explicit Writer(const FoamLayout& layout) : layout_(layout) {}

  [[nodiscard]] std::string header(const std::string& class_name) const {
    return fmt::format(
        "FoamFile\n{{\n  version 2.0;\n  format {};\n  arch \"{};label={};scalar={}\";\n  class {};\n}}\n// * * //\n",
        layout_.binary ? "binary" : "ascii", layout_.big_endian ? "MSB" : "LSB", 8 * layout_.label_bytes,
        8 * layout_.scalar_bytes, class_name);
  }

  [[nodiscard]] std::string labels(const std::vector<std::int64_t>& labels) const {
    std::string text = fmt::format("{}\n(", labels.size());
    for (const std::int64_t label : labels)
      text += !layout_.binary            ? fmt::format("{} ", label)
              : layout_.label_bytes == 8 ? bytes(label)
                                         : bytes(static_cast<std::int32_t>(label));
    return text + ")\n";
  }

  [[nodiscard]] std::string numbers(const std::vector<double>& numbers, std::size_t components) const {
    std::string text = fmt::format("{}\n(", numbers.size() / components);
    for (std::size_t i = 0; i < numbers.size(); ++i) {
      if (layout_.binary) {
        text += layout_.scalar_bytes == 8 ? bytes(numbers[i]) : bytes(static_cast<float>(numbers[i]));
        continue;
      }
      const bool first = i % components == 0, last = i % components == components - 1;
      text +=
          fmt::format("{}{}{}", components > 1 && first ? "(" : "", numbers[i], components > 1 && last ? ")\n" : " ");
    }
    return text + ")\n";
  }

  [[nodiscard]] std::string faces(const std::vector<std::vector<std::int64_t>>& faces) const {
    if (layout_.binary) {
      std::vector<std::int64_t> starts = {0}, points;
      for (const auto& face : faces) {
        points.insert(points.end(), face.begin(), face.end());
        starts.push_back(static_cast<std::int64_t>(points.size()));
      }
      return header("faceCompactList") + labels(starts) + labels(points);
    }
    std::string text = header("faceList") + fmt::format("{}\n(\n", faces.size());
    for (const auto& face : faces) text += fmt::format("{}({})\n", face.size(), fmt::join(face, " "));
    return text + ")\n";
  }

 private:
  template <class T>
  [[nodiscard]] std::string bytes(T number) const {
    std::string text(reinterpret_cast<const char*>(&number), sizeof(number));
    if (layout_.big_endian) std::ranges::reverse(text);
    return text;
  }

  const FoamLayout& layout_;
};

/// A row of cubes, [0, cells), whose first point has x = `first`.
struct CubeRow {
  std::vector<double> points;
  std::vector<std::vector<std::int64_t>> faces;
  std::vector<std::int64_t> owner, neighbour;

  CubeRow(std::size_t first, std::int64_t cells) {
    for (std::int64_t i = 0; i <= cells; ++i)
      for (const auto& [y, z] : {std::pair(0, 0), {1, 0}, {1, 1}, {0, 1}}) {
        points.push_back(static_cast<double>(first) + static_cast<double>(i));
        points.insert(points.end(), {static_cast<double>(y), static_cast<double>(z)});
      }
    for (std::int64_t i = 1; i < cells; ++i) {
      add({4 * i, 4 * i + 1, 4 * i + 2, 4 * i + 3}, i - 1);
      neighbour.push_back(i);
    }
    add({0, 3, 2, 1}, 0);
    add({4 * cells, 4 * cells + 1, 4 * cells + 2, 4 * cells + 3}, cells - 1);
    for (std::int64_t i = 0; i < cells; ++i) {
      const std::int64_t a = 4 * i, b = a + 4;
      add({a, b, b + 3, a + 3}, i);
      add({a + 1, a + 2, b + 2, b + 1}, i);
      add({a, a + 1, b + 1, b}, i);
      add({a + 3, b + 3, b + 2, a + 2}, i);
    }
  }

 private:
  void add(std::vector<std::int64_t> face, std::int64_t cell) {
    faces.push_back(std::move(face));
    owner.push_back(cell);
  }
};

/// The patches of a row of cubes. `processor`: which of `processors` has the row.
std::string patches_of(std::int64_t cells, std::size_t processor, std::size_t processors) {
  std::string patches = "3\n(\n";
  const auto add_patch = [&](const std::string& name, std::int64_t first, std::int64_t faces_of_it, int other) {
    patches += other < 0 ? fmt::format("  {}\n  {{\n    type wall;\n    inGroups List<word> 1(wall);\n", name)
                         : fmt::format(
                               "  procBoundary{}to{}\n  {{\n    type processor;\n    myProcNo {};\n    "
                               "neighbProcNo {};\n",
                               processor, other, processor, other);
    patches += fmt::format("    nFaces {};\n    startFace {};\n  }}\n", faces_of_it, first);
  };
  const std::int64_t inner = cells - 1;
  const int before = static_cast<int>(processor) - 1, after = static_cast<int>(processor) + 1;
  add_patch("left", inner, 1, processor > 0 ? before : -1);
  add_patch("right", inner + 1, 1, processor + 1 < processors ? after : -1);
  add_patch("sides", inner + 2, 4 * cells, -1);
  return patches + ")\n";
}

/// The files of the cells [begin, end). `processor`: which of layout.processors has them.
std::map<std::string, std::string> part_files(const FoamLayout& layout, std::size_t begin, std::size_t end,
                                              std::size_t processor) {
  const Writer writer(layout);
  const auto cells = static_cast<std::int64_t>(end - begin);
  const CubeRow row(begin, cells);
  std::vector<double> p, u, s, h;
  for (std::size_t cell = begin; cell < end; ++cell) {
    p.push_back(foam_value(cell));
    u.insert(u.end(), 3, foam_value(cell));
    for (std::size_t c = 0; c < 6; ++c) s.push_back(foam_value(6 * cell + c));
  }
  for (std::size_t i = 4 * begin; i < 4 * (end + 1); ++i) h.push_back(static_cast<double>(i));
  const auto field = [&](const std::string& kind, const std::string& of, const std::string& type,
                         const std::string& dimensions, const std::vector<double>& values, std::size_t components) {
    return writer.header(of + kind) +
           fmt::format(
               "dimensions {};\ninternalField nonuniform List<{}>\n{};\nboundaryField\n{{\n  sides\n  {{\n    type "
               "fixedValue;\n    value nonuniform List<scalar> {};\n  }}\n}}\n",
               dimensions, type, writer.numbers(values, components), writer.numbers({1, 2}, 1));
  };
  const std::string region = layout.region.empty() ? "" : layout.region + "/";
  const std::string mesh = "constant/" + region + "polyMesh/", step = "0.5/" + region;
  return {{mesh + "points", writer.header("vectorField") + writer.numbers(row.points, 3)},
          {mesh + "faces", writer.faces(row.faces)},
          {mesh + "owner", writer.header("labelList") + writer.labels(row.owner)},
          {mesh + "neighbour", writer.header("labelList") + writer.labels(row.neighbour)},
          {mesh + "boundary", writer.header("polyBoundaryMesh") + patches_of(cells, processor, layout.processors)},
          {step + "p", field("ScalarField", "vol", "scalar", "[1 -1 -2 0 0 0 0]", p, 1)},
          {step + "U", field("VectorField", "vol", "vector", "[velocity]", u, 3)},
          {step + "S", field("SymmTensorField", "vol", "symmTensor", "[]", s, 6)},
          {step + "h", field("ScalarField", "point", "scalar", "[length]", h, 1)}};
}

/// Several files as one, as processors that write together do. The first has a header.
std::string collated(const std::vector<std::string>& parts) {
  std::string text = "FoamFile\n{\n  version 2.0;\n  format binary;\n  class decomposedBlockData;\n}\n";
  for (std::size_t i = 0; i < parts.size(); ++i) {
    const std::size_t body = i == 0 ? 0 : parts[i].find("// * * //\n");
    const std::string part = parts[i].substr(body);
    text += fmt::format("\n// Processor{}\n\n{}\n({})\n", i, part.size(), part);
  }
  return text;
}

}  // namespace

std::string foam_file(const std::string& class_name, const std::string& body) {
  return fmt::format("FoamFile {{ version 2.0; format ascii; class {}; object it; }}\n{}", class_name, body);
}

std::string gzipped(const std::string& text) {
  z_stream state{};
  deflateInit2(&state, Z_DEFAULT_COMPRESSION, Z_DEFLATED, 16 + MAX_WBITS, 8, Z_DEFAULT_STRATEGY);
  std::string packed(deflateBound(&state, text.size()), '\0');
  std::string from = text;
  state.next_in = reinterpret_cast<Bytef*>(from.data());
  state.avail_in = static_cast<uInt>(from.size());
  state.next_out = reinterpret_cast<Bytef*>(packed.data());
  state.avail_out = static_cast<uInt>(packed.size());
  deflate(&state, Z_FINISH);
  packed.resize(packed.size() - state.avail_out);
  deflateEnd(&state);
  return packed;
}

std::map<std::string, std::string> openfoam_files(const FoamLayout& layout) {
  std::map<std::string, std::string> files = {{"case.foam", ""},
                                              {"system/controlDict", foam_file("dictionary", "startTime 0;\n")}};
  const std::size_t count = std::max<std::size_t>(layout.processors, 1);
  std::vector<std::map<std::string, std::string>> parts;
  for (std::size_t i = 0; i < count; ++i)
    parts.push_back(part_files(layout, foam_cells * i / count, foam_cells * (i + 1) / count, i));
  const auto add = [&](const std::string& name, const std::string& text) {
    files[name + (layout.packed ? ".gz" : "")] = layout.packed ? gzipped(text) : text;
  };
  std::size_t next = 0;
  for (const std::size_t some : layout.collated) {
    const std::string range = some == count ? "" : fmt::format("_{}-{}", next, next + some - 1);
    for (const auto& [name, text] : parts[next]) {
      std::vector<std::string> texts;
      for (std::size_t i = next; i < next + some; ++i) texts.push_back(parts[i].at(name));
      add(fmt::format("processors{}{}/{}", count, range, name), collated(texts));
    }
    next += some;
  }
  for (; next < count; ++next)
    for (const auto& [name, text] : parts[next])
      add(layout.processors == 0 ? name : fmt::format("processor{}/{}", next, name), text);
  return files;
}

}  // namespace splatvol::test
