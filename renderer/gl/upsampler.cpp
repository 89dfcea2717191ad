#include "renderer/gl/upsampler.h"

#include "renderer/gl/shaders.h"

namespace splatvol {

Result<Upsampler> Upsampler::create() {
  SPLATVOL_TRY_ASSIGN(program,
                      build_program("interpolation between samples", {{GL_VERTEX_SHADER, {shaders::upsample_vert}},
                                                                      {GL_FRAGMENT_SHADER, {shaders::upsample_frag}}}));
  GLuint name = 0;
  glCreateVertexArrays(1, &name);
  return Upsampler(std::move(program), VertexArray(name));
}

Status Upsampler::run(const Target& samples, int spacing, const Target& picture) {
  SPLATVOL_TRY(rows_.resize(picture.width(), samples.height()));
  glUseProgram(program_.name());
  glBindVertexArray(no_attributes_.name());
  pass(samples, 0, spacing, rows_);
  pass(rows_, 1, spacing, picture);
  return check_gl("interpolating between samples");
}

void Upsampler::pass(const Target& from, int axis, int spacing, const Target& to) const {
  to.use();
  glBindTextureUnit(2, from.texture());
  glUniform1i(0, axis);
  glUniform1f(1, static_cast<GLfloat>(spacing));
  glUniform1f(2, 0.5F * static_cast<GLfloat>(axis == 0 ? to.width() : to.height()));
  glDrawArrays(GL_TRIANGLES, 0, 3);
}

}  // namespace splatvol
