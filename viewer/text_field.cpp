#include "viewer/text_field.h"

#include <imgui.h>

namespace splatvol {

void TextField::draw(const char* name) { ImGui::InputText(name, text_.data(), text_.size()); }

}  // namespace splatvol
