#include "renderer/gl/gl_objects.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <vector>

namespace splatvol {

namespace {

using Shader = GlObject<[](GLuint name) { glDeleteShader(name); }>;

std::string_view error_text(GLenum error) {
  constexpr std::array<std::pair<GLenum, std::string_view>, 5> texts = {
      {{GL_INVALID_ENUM, "invalid enum"},
       {GL_INVALID_VALUE, "invalid value"},
       {GL_INVALID_OPERATION, "invalid operation"},
       {GL_INVALID_FRAMEBUFFER_OPERATION, "invalid framebuffer operation"},
       {GL_OUT_OF_MEMORY, "out of memory"}}};
  const auto found = std::ranges::find(texts, error, &std::pair<GLenum, std::string_view>::first);
  return found == texts.end() ? "unknown error" : found->second;
}

std::string first_line(std::string log) {
  log.resize(std::min(log.size(), log.find_first_of(std::string_view("\n\0", 2))));
  return log;
}

Result<Shader> compile(std::string_view program, const ShaderStage& stage) {
  std::vector<const GLchar*> texts;
  std::vector<GLint> lengths;
  for (const std::string_view source : stage.sources) {
    texts.push_back(source.data());
    lengths.push_back(static_cast<GLint>(source.size()));
  }

  Shader shader(glCreateShader(stage.kind));
  glShaderSource(shader.name(), static_cast<GLsizei>(texts.size()), texts.data(), lengths.data());
  glCompileShader(shader.name());

  GLint compiled = GL_FALSE;
  glGetShaderiv(shader.name(), GL_COMPILE_STATUS, &compiled);
  if (compiled == GL_TRUE) return shader;
  std::string log(4096, '\0');
  glGetShaderInfoLog(shader.name(), static_cast<GLsizei>(log.size()), nullptr, log.data());
  return fail(ErrorCode::device, "shader of {} does not compile: {}", program, first_line(std::move(log)));
}

}  // namespace

std::string device_text() {
  const auto text = [](GLenum name) {
    const GLubyte* found = glGetString(name);
    return found ? reinterpret_cast<const char*>(found) : "unknown";
  };
  return fmt::format("{}, OpenGL {}", text(GL_RENDERER), text(GL_VERSION));
}

Status check_current_context() {
  if (epoxy_gl_version() >= 45 && epoxy_is_desktop_gl()) return {};
  return fail(ErrorCode::device, "OpenGL 4.5 is needed, the current context has {}.{} (0.0: there is none)",
              epoxy_gl_version() / 10, epoxy_gl_version() % 10);
}

std::uint64_t largest_buffer() {
  GLint64 limit = 0;
  glGetInteger64v(GL_MAX_SHADER_STORAGE_BLOCK_SIZE, &limit);
  return static_cast<std::uint64_t>(limit);
}

Status Buffer::reserve(std::size_t bytes) {
  if (bytes <= bytes_) return {};
  const std::uint64_t limit = largest_buffer();
  if (bytes > limit)
    return fail(ErrorCode::device, "{}: {} bytes, but this device's shaders see {} bytes of a buffer at most", name_,
                bytes, limit);

  // The old storage goes first, so that both are never held together.
  object_ = {};
  bytes_ = 0;
  GLuint object = 0;
  glCreateBuffers(1, &object);
  object_ = GlObject<delete_buffer>(object);
  glNamedBufferStorage(object, static_cast<GLsizeiptr>(bytes), nullptr, GL_DYNAMIC_STORAGE_BIT | GL_MAP_READ_BIT);
  SPLATVOL_TRY(check_gl(name_));
  bytes_ = bytes;
  return {};
}

void Buffer::write_at(std::size_t offset, const void* data, std::size_t bytes) {
  if (bytes > 0)
    glNamedBufferSubData(object_.name(), static_cast<GLintptr>(offset), static_cast<GLsizeiptr>(bytes), data);
}

const void* Buffer::map_to_read(std::size_t bytes) {
  return glMapNamedBufferRange(object_.name(), 0, static_cast<GLsizeiptr>(bytes), GL_MAP_READ_BIT);
}

void Buffer::unmap() { glUnmapNamedBuffer(object_.name()); }

Result<Program> build_program(std::string_view name, std::initializer_list<ShaderStage> stages) {
  Program program(glCreateProgram());
  for (const ShaderStage& stage : stages) {
    SPLATVOL_TRY_ASSIGN(shader, compile(name, stage));
    glAttachShader(program.name(), shader.name());
  }
  glLinkProgram(program.name());

  GLint linked = GL_FALSE;
  glGetProgramiv(program.name(), GL_LINK_STATUS, &linked);
  if (linked == GL_TRUE) return program;
  std::string log(4096, '\0');
  glGetProgramInfoLog(program.name(), static_cast<GLsizei>(log.size()), nullptr, log.data());
  return fail(ErrorCode::device, "program of {} does not link: {}", name, first_line(std::move(log)));
}

Status check_gl(std::string_view action) {
  // Only the first error matters. The rest is drained, so that the next check starts clean. The bound is for a lost
  // context, which could report errors forever.
  const GLenum first = glGetError();
  if (first == GL_NO_ERROR) return {};
  for (int i = 0; i < 16 && glGetError() != GL_NO_ERROR; ++i) continue;
  return fail(ErrorCode::device, "{}: OpenGL reports {}", action, error_text(first));
}

}  // namespace splatvol
