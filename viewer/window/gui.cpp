#include "viewer/window/gui.h"

#include <imgui.h>

#include <array>
#include <cmath>
#include <cstddef>
#include <span>
#include <utility>

#include "pictures/font_data.h"
#include "viewer/window/gui_lists.h"
#include "viewer/window/gui_units.h"

namespace splatvol {
namespace {

constexpr std::string_view vertex_source = R"(#version 450 core
layout(location = 0) in vec2 position;
layout(location = 1) in vec2 font_position;
layout(location = 2) in vec4 tint;
layout(location = 0) uniform vec2 display;
layout(location = 1) uniform float up;  // 1 or -1
out vec2 at;
out vec4 color;
void main() {
  at = font_position;
  color = tint;
  gl_Position = vec4(2 * position.x / display.x - 1, up * (1 - 2 * position.y / display.y), 0, 1);
}
)";

constexpr std::string_view fragment_source = R"(#version 450 core
in vec2 at;
in vec4 color;
layout(binding = 0) uniform sampler2D font;
layout(location = 0) out vec4 result;
void main() { result = color * texture(font, at); }
)";

constexpr std::array<std::pair<int, ImGuiKey>, 17> named_keys = {{{key::tab, ImGuiKey_Tab},
                                                                  {key::left, ImGuiKey_LeftArrow},
                                                                  {key::right, ImGuiKey_RightArrow},
                                                                  {key::up, ImGuiKey_UpArrow},
                                                                  {key::down, ImGuiKey_DownArrow},
                                                                  {key::home, ImGuiKey_Home},
                                                                  {key::end, ImGuiKey_End},
                                                                  {key::del, ImGuiKey_Delete},
                                                                  {key::backspace, ImGuiKey_Backspace},
                                                                  {key::enter, ImGuiKey_Enter},
                                                                  {key::escape, ImGuiKey_Escape},
                                                                  {'A', ImGuiKey_A},
                                                                  {'C', ImGuiKey_C},
                                                                  {'V', ImGuiKey_V},
                                                                  {'X', ImGuiKey_X},
                                                                  {'Y', ImGuiKey_Y},
                                                                  {'Z', ImGuiKey_Z}}};

// Dear ImGui takes events since 1.87, with these names since 1.89. Older versions have only state.
#if IMGUI_VERSION_NUM >= 18900
void feed(ImGuiIO& io, const PointerMoved& e) { io.AddMousePosEvent(float(e.x), float(e.y)); }
void feed(ImGuiIO& io, const ButtonChanged& e) {
  if (e.button >= 0 && e.button < 3) io.AddMouseButtonEvent(e.button, e.down);
}
void feed(ImGuiIO& io, const Scrolled& e) { io.AddMouseWheelEvent(float(e.x), float(e.y)); }
void feed(ImGuiIO& io, const KeyChanged& e) {
  if (e.code == key::left_control || e.code == key::right_control) io.AddKeyEvent(ImGuiMod_Ctrl, e.down);
  if (e.code == key::left_shift || e.code == key::right_shift) io.AddKeyEvent(ImGuiMod_Shift, e.down);
  for (const auto& [code, name] : named_keys)
    if (code == e.code) io.AddKeyEvent(name, e.down);
}
void name_keys(ImGuiIO&) {}
#else
void feed(ImGuiIO& io, const PointerMoved& e) { io.MousePos = ImVec2(float(e.x), float(e.y)); }
void feed(ImGuiIO& io, const ButtonChanged& e) {
  if (e.button >= 0 && e.button < 3) io.MouseDown[e.button] = e.down;
}
void feed(ImGuiIO& io, const Scrolled& e) { io.MouseWheel += float(e.y), io.MouseWheelH += float(e.x); }
void feed(ImGuiIO& io, const KeyChanged& e) {
  io.KeysDown[e.code] = e.down;
  io.KeyCtrl = io.KeysDown[key::left_control] || io.KeysDown[key::right_control];
  io.KeyShift = io.KeysDown[key::left_shift] || io.KeysDown[key::right_shift];
}
void name_keys(ImGuiIO& io) {
  static_assert(key::count <= IM_ARRAYSIZE(ImGuiIO::KeysDown));
  for (const auto& [code, name] : named_keys) io.KeyMap[name] = code;
}
#endif
void feed(ImGuiIO& io, const TextTyped& e) { io.AddInputCharacter(e.character); }
void feed(ImGuiIO&, const WindowResized&) {}
void feed(ImGuiIO&, const FilesDropped&) {}

}  // namespace

Result<std::unique_ptr<Gui>> Gui::create(double scale, Clipboard clipboard) {
  std::unique_ptr<Gui> gui(new Gui);
  gui->clipboard_ = std::move(clipboard);
  gui->context_ = ImGui::CreateContext();
  ImGuiIO& io = ImGui::GetIO();
  io.IniFilename = nullptr;
  io.BackendFlags |= ImGuiBackendFlags_RendererHasVtxOffset;
  name_keys(io);
  io.ClipboardUserData = gui.get();
  io.SetClipboardTextFn = [](void* user, const char* text) {
    Gui& of = *static_cast<Gui*>(user);
    of.copied_ = text;
    if (of.clipboard_.copy) of.clipboard_.copy(of.copied_);
  };
  io.GetClipboardTextFn = [](void* user) {
    Gui& of = *static_cast<Gui*>(user);
    if (of.clipboard_.paste) of.copied_ = of.clipboard_.paste();
    return of.copied_.c_str();
  };
  SPLATVOL_TRY_ASSIGN(program, build_program("interface", {{GL_VERTEX_SHADER, {vertex_source}},
                                                           {GL_FRAGMENT_SHADER, {fragment_source}}}));
  gui->program_ = std::move(program);
  GLuint name = 0;
  glCreateVertexArrays(1, &name);
  gui->vertex_array_ = VertexArray(name);
  const auto attribute = [&](GLuint index, GLint size, GLenum type, GLboolean normalized, std::size_t offset) {
    glEnableVertexArrayAttrib(name, index);
    glVertexArrayAttribFormat(name, index, size, type, normalized, static_cast<GLuint>(offset));
    glVertexArrayAttribBinding(name, index, 0);
  };
  attribute(0, 2, GL_FLOAT, GL_FALSE, offsetof(ImDrawVert, pos));
  attribute(1, 2, GL_FLOAT, GL_FALSE, offsetof(ImDrawVert, uv));
  attribute(2, 4, GL_UNSIGNED_BYTE, GL_TRUE, offsetof(ImDrawVert, col));
  SPLATVOL_TRY(gui->make_font(scale));
  return gui;
}

Gui::~Gui() { ImGui::DestroyContext(context_); }

Status Gui::make_font(double scale) {
  if (scale == scale_) return {};
  scale_ = scale;
  ImGuiIO& io = ImGui::GetIO();
  io.Fonts->Clear();
  // Latin, Greek and Cyrillic letters, and what units and ticks of decades need.
  static constexpr ImWchar characters[] = {0x20, 0x17F, 0x370, 0x4FF, 0x2010, 0x209F, 0x2200, 0x22FF, 0};
  const std::span<const unsigned char> font = font_bytes();
  ImFontConfig config;
  config.FontDataOwnedByAtlas = false;
  io.Fonts->AddFontFromMemoryTTF(const_cast<unsigned char*>(font.data()), static_cast<int>(font.size()),
                                 std::round(font_height * static_cast<float>(scale)), &config, characters);
  unsigned char* pixels = nullptr;
  int width = 0, height = 0;
  io.Fonts->GetTexDataAsRGBA32(&pixels, &width, &height);
  GLuint name = 0;
  glCreateTextures(GL_TEXTURE_2D, 1, &name);
  font_ = Texture(name);
  glTextureStorage2D(name, 1, GL_RGBA8, width, height);
  glPixelStorei(GL_UNPACK_ALIGNMENT, 4);
  glTextureSubImage2D(name, 0, 0, 0, width, height, GL_RGBA, GL_UNSIGNED_BYTE, pixels);
  glTextureParameteri(name, GL_TEXTURE_MIN_FILTER, GL_LINEAR);

  return check_gl("the interface's font");
}

void Gui::set_style(double scale, bool light) {
  ImGuiStyle& style = ImGui::GetStyle();
  style = ImGuiStyle();
  light ? ImGui::StyleColorsLight() : ImGui::StyleColorsDark();
  style.WindowRounding = 4;
  style.FrameRounding = 3;
  style.Colors[ImGuiCol_WindowBg].w = 0.85f;
  style.ScaleAllSizes(static_cast<float>(scale));
}

Status Gui::begin(const FrameInput& input, const WindowResized& window, bool light) {
  SPLATVOL_TRY(make_font(window.content_scale));
  if (styled_ != std::pair(window.content_scale, light)) {
    styled_ = {window.content_scale, light};
    set_style(window.content_scale, light);
  }
  ImGuiIO& io = ImGui::GetIO();
  io.DisplaySize = ImVec2(static_cast<float>(window.width), static_cast<float>(window.height));
  if (window.width > 0 && window.height > 0)
    io.DisplayFramebufferScale = ImVec2(static_cast<float>(window.pixel_width) / static_cast<float>(window.width),
                                        static_cast<float>(window.pixel_height) / static_cast<float>(window.height));
  constexpr double shortest = 1e-4, longest = 1;  // seconds that Dear ImGui can handle
  io.DeltaTime = static_cast<float>(std::min(std::max(input.seconds, shortest), longest));
  for (const Event& event : input.events) std::visit([&](const auto& e) { feed(io, e); }, event);
  ImGui::NewFrame();
  return {};
}

bool Gui::has_pointer() const { return ImGui::GetIO().WantCaptureMouse; }

bool Gui::has_keyboard() const { return ImGui::GetIO().WantTextInput; }

void Gui::end() { ImGui::Render(); }

Gui::Lists Gui::lists() const {
  const ImDrawData& data = *ImGui::GetDrawData();
  if (data.CmdListsCount == 0) return {};
  return {&data.CmdLists[0], static_cast<std::size_t>(data.CmdListsCount)};  // an array, or a vector of later versions
}

// Dear ImGui draws the list of overlays first, unless it is empty.
Gui::Lists Gui::overlays() const {
  const Lists all = lists();
  return all.first(!all.empty() && all.front() == ImGui::GetBackgroundDrawList() ? 1 : 0);
}

Gui::Lists Gui::windows() const { return lists().subspan(overlays().size()); }

dvec2 Gui::pixels_of_unit() const {
  const ImVec2 scale = ImGui::GetDrawData()->FramebufferScale;
  return {scale.x, scale.y};
}

Status Gui::upload(Lists lists) {
  std::size_t vertices = 0, indices = 0;
  for (const ImDrawList* list : lists) {
    vertices += static_cast<std::size_t>(list->VtxBuffer.size_in_bytes());
    indices += static_cast<std::size_t>(list->IdxBuffer.size_in_bytes());
  }
  SPLATVOL_TRY(vertices_.reserve(vertices));
  SPLATVOL_TRY(indices_.reserve(indices));
  std::size_t vertex = 0, index = 0;  // bytes
  const auto write = [](const Buffer& buffer, std::size_t& offset, const auto& items) {
    const auto bytes = static_cast<std::size_t>(items.size_in_bytes());
    glNamedBufferSubData(buffer.object(), static_cast<GLintptr>(offset), static_cast<GLsizeiptr>(bytes), items.Data);
    offset += bytes;
  };
  for (const ImDrawList* list : lists) {
    write(vertices_, vertex, list->VtxBuffer);
    write(indices_, index, list->IdxBuffer);
  }
  return {};
}

void Gui::set_state(int width, int height, bool top_first) const {
  const ImVec2 display = ImGui::GetDrawData()->DisplaySize;
  glViewport(0, 0, width, height);
  glEnable(GL_BLEND);
  glBlendEquation(GL_FUNC_ADD);
  glBlendFuncSeparate(GL_SRC_ALPHA, GL_ONE_MINUS_SRC_ALPHA, GL_ONE, GL_ONE_MINUS_SRC_ALPHA);
  glDisable(GL_DEPTH_TEST);
  glDisable(GL_CULL_FACE);
  glEnable(GL_SCISSOR_TEST);
  glUseProgram(program_.name());
  glUniform2f(0, display.x, display.y);
  glUniform1f(1, top_first ? -1.0F : 1.0F);
  glBindTextureUnit(0, font_.name());
  glVertexArrayVertexBuffer(vertex_array_.name(), 0, vertices_.object(), 0, sizeof(ImDrawVert));
  glVertexArrayElementBuffer(vertex_array_.name(), indices_.object());
  glBindVertexArray(vertex_array_.name());
}

Status Gui::draw() {
  const ImDrawData& data = *ImGui::GetDrawData();
  const PixelRect all{0, 0, static_cast<int>(data.DisplaySize.x * data.FramebufferScale.x),
                      static_cast<int>(data.DisplaySize.y * data.FramebufferScale.y)};
  return draw(lists(), {&all, 1}, false);
}

Status Gui::draw(Lists lists, std::span<const PixelRect> within, bool top_first) {
  const ImDrawData& data = *ImGui::GetDrawData();
  const dvec2 scale = pixels_of_unit();
  const int width = static_cast<int>(data.DisplaySize.x * scale.x),
            height = static_cast<int>(data.DisplaySize.y * scale.y);
  if (width <= 0 || height <= 0 || lists.empty() || within.empty()) return {};
  SPLATVOL_TRY(upload(lists));

  set_state(width, height, top_first);
  for (const PixelRect& part : within) {
    std::size_t vertex = 0, index = 0;
    for (const ImDrawList* list : lists) {
      for (const ImDrawCmd& command : list->CmdBuffer) {
        const PixelRect clip = intersection(clip_of(command, scale), part);
        if (clip.is_empty()) continue;
        glScissor(clip.left, top_first ? clip.top : height - clip.bottom, clip.right - clip.left,
                  clip.bottom - clip.top);
        glDrawElementsBaseVertex(GL_TRIANGLES, static_cast<GLsizei>(command.ElemCount),
                                 sizeof(ImDrawIdx) == 2 ? GL_UNSIGNED_SHORT : GL_UNSIGNED_INT,
                                 reinterpret_cast<const void*>((index + command.IdxOffset) * sizeof(ImDrawIdx)),
                                 static_cast<GLint>(vertex + command.VtxOffset));
      }
      vertex += static_cast<std::size_t>(list->VtxBuffer.Size);
      index += static_cast<std::size_t>(list->IdxBuffer.Size);
    }
  }
  glDisable(GL_SCISSOR_TEST);
  glDisable(GL_BLEND);
  glBindVertexArray(0);
  return check_gl("the interface");
}

}  // namespace splatvol
