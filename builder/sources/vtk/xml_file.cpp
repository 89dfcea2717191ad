#include "builder/sources/vtk/xml_file.h"

#include <vtkObjectFactory.h>

#include "builder/sources/vtk/messages.h"

namespace splatvol {
namespace {

constexpr int deepest = 64;

/// Leaves out the elements below the deepest level.
class ShallowParser final : public vtkXMLDataParser {
 public:
  static ShallowParser* New() { VTK_STANDARD_NEW_BODY(ShallowParser); }

  [[nodiscard]] bool is_too_deep() const { return too_deep_; }

 protected:
  void StartElement(const char* name, const char** attributes) override {
    if (++depth_ > deepest)
      too_deep_ = true;
    else
      vtkXMLDataParser::StartElement(name, attributes);
  }
  void EndElement(const char* name) override {
    if (depth_-- <= deepest) vtkXMLDataParser::EndElement(name);
  }

 private:
  int depth_ = 0;
  bool too_deep_ = false;
};

}  // namespace

Result<vtkSmartPointer<vtkXMLDataParser>> parse_xml(const std::string& path) {
  const auto parser = vtkSmartPointer<ShallowParser>::New();
  bool whole = false;
  SPLATVOL_TRY(run_vtk(path, [&] {
    parser->SetFileName(path.c_str());
    whole = parser->Parse() != 0;
  }));
  if (parser->is_too_deep())
    return fail(ErrorCode::invalid_data, "{}: its elements are nested deeper than {} levels", path, deepest);
  if (!whole || !parser->GetRootElement())
    return fail(ErrorCode::invalid_data, "{}: damaged: not a whole XML file", path);
  return vtkSmartPointer<vtkXMLDataParser>(parser);
}

}  // namespace splatvol
