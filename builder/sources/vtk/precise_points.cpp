#include "builder/sources/vtk/precise_points.h"

#include <vtkObjectFactory.h>
#include <vtkPoints.h>
#include <vtkVersion.h>

namespace splatvol {
namespace {

class DoublePoints final : public vtkPoints {
 public:
  static DoublePoints* New();
  vtkTypeMacro(DoublePoints, vtkPoints)

      protected : DoublePoints()
      : vtkPoints(VTK_DOUBLE) {}
};
vtkStandardNewMacro(DoublePoints);

class PointsFactory final : public vtkObjectFactory {
 public:
  static PointsFactory* New();
  vtkTypeMacro(PointsFactory, vtkObjectFactory)

      const char* GetVTKSourceVersion() override {
    return VTK_SOURCE_VERSION;
  }
  const char* GetDescription() override { return "points of double precision"; }

 protected:
  PointsFactory() {
    RegisterOverride("vtkPoints", "DoublePoints", GetDescription(), 1,
                     [] { return static_cast<vtkObject*>(DoublePoints::New()); });
  }
};
vtkStandardNewMacro(PointsFactory);

}  // namespace

PrecisePoints::PrecisePoints() : factory_(vtkSmartPointer<PointsFactory>::New()) {
  vtkObjectFactory::RegisterFactory(factory_);
}

PrecisePoints::~PrecisePoints() { vtkObjectFactory::UnRegisterFactory(factory_); }

}  // namespace splatvol
