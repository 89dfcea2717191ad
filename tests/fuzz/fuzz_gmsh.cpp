// A .msh file of Gmsh.
#include "builder/sources/gmsh/gmsh_file.h"
#include "tests/fuzz/fuzz.h"

using namespace splatvol;
using splatvol::fuzz::require;

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const fuzz::NamedBytes named(fuzz::bytes_of(data, size));
  static_cast<void>(read_gmsh_views(named.path()));
  const auto file = read_gmsh(named.path(), true);
  if (!file) return 0;
  require(file->node_tags.size() == file->points.size(), "a node has a position");
  require(file->elements.types.size() == file->elements.tags.size(), "an element has a tag");
  std::size_t nodes = 0;
  for (const int type : file->elements.types) {
    require(gmsh_node_count(type).has_value(), "the type of an element is known");
    nodes += *gmsh_node_count(type);
  }
  require(nodes == file->elements.nodes.size(), "an element has its nodes");
  for (const GmshGroup& group : file->groups)
    for (const std::size_t element : group.elements)
      require(element < file->elements.types.size(), "a group has elements of the file");
  for (const GmshView& view : file->views) {
    std::size_t values = view.tags.size();
    if (view.at == GmshView::At::element_nodes) {
      require(view.counts.size() == view.tags.size(), "an element has a number of values");
      values = 0;
      for (const std::uint32_t count : view.counts) values += count;
    }
    require(view.values.size() == values * view.components, "a view has its values");
  }
  return 0;
}
