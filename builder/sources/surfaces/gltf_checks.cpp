#include "builder/sources/surfaces/gltf_checks.h"

#include <fmt/format.h>

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <stdexcept>
#include <vector>

#include "base/file.h"
#include "base/json.h"
#include "base/nesting.h"
#include "builder/sources/read_text.h"

namespace splatvol {
namespace {

using nlohmann::json;

constexpr double most_parts = 0x1p20, most_nodes = 0x1p21;
constexpr int most_nesting = 256;

/// Reads the JSON of a file, which is all of a .gltf, and the first chunk of a .glb.
Result<std::string> read_json(const std::string& path) {
  constexpr std::uint64_t header_bytes = 20;
  SPLATVOL_TRY_ASSIGN(file, open_file(path));
  SPLATVOL_TRY_ASSIGN(header, read_text(*file, 0, header_bytes));
  if (header.compare(0, 4, "glTF") != 0) return read_text(*file, 0, file->size());
  if (header.size() < header_bytes) return fail(ErrorCode::invalid_data, "{}: the file is cut off", path);
  return read_text(*file, header_bytes, number_in(std::string_view(header).substr(12, 4), false));
}

/// A node, and how many paths lead to it: each shows it once.
struct Node {
  std::vector<std::size_t> children;
  double primitives = 0;  // of its mesh
  double instances = 0;
  std::size_t parents = 0;  // that are not counted yet, with repetitions
};

/// The element `name` of an object, or an empty list.
const json& list_of(const json& object, const char* name) {
  static const json empty = json::array();
  const auto found = object.find(name);
  if (found == object.end()) return empty;
  if (!found->is_array()) throw std::invalid_argument(fmt::format("its {} are no list", name));
  return *found;
}

std::size_t index_in(const json& number, std::size_t count, const char* what) {
  if (!number.is_number_unsigned() || number.get<std::uint64_t>() >= count)
    throw std::invalid_argument(fmt::format("it names a {} that is not there", what));
  return number.get<std::size_t>();
}

std::vector<Node> nodes_of(const json& document) {
  const json& meshes = list_of(document, "meshes");
  std::vector<Node> nodes(list_of(document, "nodes").size());
  for (std::size_t i = 0; i < nodes.size(); ++i) {
    const json& node = document["nodes"][i];
    for (const json& child : list_of(node, "children"))
      nodes[i].children.push_back(index_in(child, nodes.size(), "node"));
    if (const auto mesh = node.find("mesh"); mesh != node.end())
      nodes[i].primitives =
          static_cast<double>(list_of(meshes[index_in(*mesh, meshes.size(), "mesh")], "primitives").size());
  }
  return nodes;
}

/// Returns the nodes that scenes show, and counts the parents of each.
std::vector<std::size_t> shown_nodes(const json& document, std::vector<Node>& nodes) {
  std::vector<std::size_t> shown;
  std::vector<bool> seen(nodes.size());
  const auto show = [&](std::size_t node) {
    if (!seen[node]) shown.push_back(node);
    seen[node] = true;
  };
  for (const json& scene : list_of(document, "scenes"))
    for (const json& root : list_of(scene, "nodes")) {
      const std::size_t node = index_in(root, nodes.size(), "node");
      ++nodes[node].instances;
      show(node);
    }
  for (std::size_t i = 0; i < shown.size(); ++i)
    for (const std::size_t child : nodes[shown[i]].children) {
      ++nodes[child].parents;
      show(child);
    }
  return shown;
}

/// Fails unless the files that hold buffers are there: VTK's reader crashes without them.
Status check_buffers(const std::string& path, const json& document) {
  for (const json& buffer : list_of(document, "buffers")) {
    const auto uri = buffer.is_object() ? buffer.find("uri") : buffer.end();
    if (!buffer.is_object() || uri == buffer.end() || !uri->is_string()) continue;
    const auto& name = uri->get_ref<const std::string&>();
    if (name.starts_with("data:")) continue;
    const auto named = open_file(std::filesystem::path(path).parent_path() / name);
    if (!named) return fail_in(path, named.error());
  }
  return {};
}

/// What all scenes show. The numbers may be infinite.
struct Shown {
  double nodes = 0, parts = 0;
};

/// Returns nothing if a node contains itself.
std::optional<Shown> count_shown(const json& document) {
  std::vector<Node> nodes = nodes_of(document);
  const std::vector<std::size_t> shown = shown_nodes(document, nodes);
  // Each node after all of its parents.
  std::vector<std::size_t> counted;
  for (const std::size_t node : shown)
    if (nodes[node].parents == 0) counted.push_back(node);
  Shown all;
  for (std::size_t i = 0; i < counted.size(); ++i) {
    const Node& node = nodes[counted[i]];
    all.nodes += node.instances;
    if (node.primitives > 0) all.parts += node.instances * node.primitives;
    for (const std::size_t child : node.children) {
      nodes[child].instances += node.instances;
      if (--nodes[child].parents == 0) counted.push_back(child);
    }
  }
  return counted.size() == shown.size() ? std::optional(all) : std::nullopt;
}

}  // namespace

Status check_gltf(const std::string& path) try {
  SPLATVOL_TRY_ASSIGN(text, read_json(path));
  if (is_nested_deeper(text, most_nesting))
    return fail(ErrorCode::invalid_data, "{}: its JSON is nested deeper than {} levels", path, most_nesting);
  const json document = parse_json(text);
  SPLATVOL_TRY(check_buffers(path, document));
  const auto shown = count_shown(document);
  if (!shown) return fail(ErrorCode::invalid_data, "{}: a node contains itself: damaged", path);
  if (shown->parts <= most_parts && shown->nodes <= most_nodes) return {};
  return fail(ErrorCode::unsupported,
              "{}: its scenes show {:.3g} nodes with {:.3g} parts, and at most {} parts are read: join parts, or leave "
              "out copies of them",
              path, shown->nodes, shown->parts, most_parts);
} catch (const json::exception&) {
  return fail(ErrorCode::invalid_data, "{}: its JSON is damaged or cut off", path);
} catch (const std::invalid_argument& error) {
  return fail(ErrorCode::invalid_data, "{}: {}: damaged", path, error.what());
}

}  // namespace splatvol
