// The Design step: preview and full build, here or by the daemon.
#include "viewer/panels/design_panel.h"

#include <QCheckBox>
#include <QElapsedTimer>
#include <QScopeGuard>

#include <nlohmann/json.hpp>

#include "core/file.h"
#include "core/mesh_io.h"
#include "pipeline/design_job.h"
#include "rendering/charts.h"
#include "viewer/model/daemon_requests.h"
#include "viewer/scene/prepared_surface.h"

namespace gnathion {
namespace {

namespace fs = std::filesystem;

fs::path next_design_folder(const fs::path& folder) {
  std::error_code ec;
  for (int i = 1;; ++i) {
    const fs::path at = folder / "designs" / QString("design_%1").arg(i, 3, 10, QChar('0')).toStdString();
    if (!fs::exists(at, ec)) return at;
  }
}

/// What a design is made from; copies the jaws, so in the background.
SplintInputs inputs_of(const CaseContent& c, const SessionState& s) {
  SplintInputs in;
  in.maxilla = *c.mesh("maxilla_mi");
  in.mandible_mi = *c.mesh("mandible_mi");
  in.therapeutic = Motion<Dental>(*s.therapeutic);
  in.arch = s.arch;
  in.edits = s.edits;
  return in;
}

}  // namespace

void DesignPanel::preview() {
  if (!document().is_open() || !document().state().therapeutic || !document().content().arch) {
    preview_note_->setText("needs T_th");
    return;
  }
  preview_note_->setText("updating…");
  bench_.scene.hold_coarse(
      true);  // a picture in full detail of what is just changing would take its time from it
  auto made = std::make_shared<std::shared_ptr<PreparedSurface>>();
  auto trouble = std::make_shared<std::string>();
  auto timer = std::make_shared<QElapsedTimer>();
  timer->start();
  const auto content = document().shared_content();
  const auto rest = [this, asked = ++previews_asked_] {
    if (asked == previews_asked_) bench_.scene.hold_coarse(false);
  };
  bench_.jobs.run_latest(
      "preview",
      [previewer = previewer_, content, state = document().state(), made, trouble](JobContext&) {
        auto preview = previewer->build(inputs_of(*content, state), state.parameters);
        if (preview)
          *made = prepare_surface(std::make_shared<const TriangleMesh>(std::move(preview->splint)));
        else
          *trouble = preview.error().why;
      },
      [this, made, trouble, timer, content, rest] {
        const auto at_the_end = qScopeGuard(rest);
        if (!preview_->isChecked() || document().shared_content() != content) return;
        if (!*made) return preview_note_->setText(QString::fromStdString(*trouble));
        Layer layer;
        layer.id = "preview";
        layer.name = "Preview, not verified";
        layer.group = "Design";
        bench_.scene.offer(*made);  // seen at once, without another turn of a thread
        layer.mesh = (*made)->mesh;
        layer.color_3d = {0.80, 0.62, 0.78};
        layer.color_2d = safe_palette::kPurple;
        layer.width_2d_px = 2.0;
        layer.opacity = 0.85;
        document().layers().set_visible("splint", false);
        document().layers().put(std::move(layer));
        pose_jaws();
        preview_note_->setText(
            QString("%1 s").arg(static_cast<double>(timer->elapsed()) / 1000.0, 0, 'f', 2));
      },
      rest);
}

void DesignPanel::build() {
  const auto content = document().shared_content();
  if (!document().state().therapeutic)
    return document().report("T_th is not set yet: set it in the Transformation step.");
  if (bench_.daemon.serves_case()) return build_by_daemon();
  if (bench_.jobs.busy()) return document().report("A job is running already: wait for it, or cancel it.");
  const SessionState state = document().state();
  const fs::path target = next_design_folder(content->folder);
  build_->setEnabled(false);
  cancel_->setEnabled(true);
  auto trouble = std::make_shared<std::string>();
  bench_.jobs.run(
      "Building the splint",
      [content, state, target, trouble](JobContext& context) {
        const auto build_into = [&]() -> Status {
          std::error_code ec;
          fs::create_directories(target.parent_path(), ec);
          GNATHION_TRY(StagedDirectory staged, StagedDirectory::create(target, false));
          const fs::path transform = staged.path() / "T_th.json";
          GNATHION_CHECK_OK(
              write_json(transform, motion_json(Motion<Dental>(*state.therapeutic), std::nullopt,
                                                {{"from", state.therapeutic_source}})));
          DesignJob job;
          job.maxilla = content->files.maxilla_mi;
          job.mandible = content->files.mandible_mi;
          job.transform = transform;
          job.shown_folder = content->folder;
          job.shown_transform = fs::path("designs") / target.filename() / "T_th.json";
          job.arch = state.arch;
          job.edits = state.edits;
          job.parameters = state.parameters;
          job.pictures = false;  // off-screen pictures need the one OpenGL thread that the window has
          GNATHION_TRY(const DesignOutcome outcome, run_design(job, staged.path(), context));
          context.throw_if_cancelled();
          return staged.commit();
        };
        if (const Status done = build_into(); !done) *trouble = done.error().line();
      },
      [this, target, trouble](bool cancelled) { built(target, cancelled, *trouble); });
}

/// The case is the daemon's: its processes compute, the window only follows.
void DesignPanel::build_by_daemon() {
  const auto request = design_request(document().content(), document().state());
  if (!request) return document().report(QString::fromStdString(request.error().line()));
  build_->setEnabled(false);
  cancel_->setEnabled(true);
  bench_.daemon.submit(
      *request, [this, target = document().content().folder / output_of(*request)](const client::Job& job) {
        build_->setEnabled(document().content().arch.has_value());
        cancel_->setEnabled(false);
        const bool made = job.state == client::JobState::kDone || job.state == client::JobState::kGateFailed;
        if (made && target.parent_path().parent_path() == document().content().folder)
          built(target, false, "");
      });
}

void DesignPanel::built(const fs::path& folder, bool cancelled, const std::string& trouble) {
  build_->setEnabled(true);
  cancel_->setEnabled(false);
  if (cancelled) return bench_.status("The build was cancelled; nothing was written.");
  if (!trouble.empty()) return document().report(QString::fromStdString(trouble));
  if (folder.parent_path().parent_path() != document().content().folder)
    return document().notice("Built: " + QString::fromStdString(folder.string()));  // another case by now
  auto mesh = std::make_shared<std::shared_ptr<const TriangleMesh>>();
  auto report = std::make_shared<std::shared_ptr<const nlohmann::json>>();
  bench_.jobs.run_latest(
      "read design",
      [folder, mesh, report](JobContext&) {
        for (const char* file : {"splint.stl", "splint.rejected.stl"})
          if (auto m = read_mesh(folder / file)) *mesh = std::make_shared<const TriangleMesh>(std::move(*m));
        if (auto j = read_json(folder / "design.json"))
          *report = std::make_shared<const nlohmann::json>(std::move(*j));
      },
      [this, mesh, report, folder, content = document().shared_content()] {
        if (document().shared_content() != content) return;
        report_ = *report;
        if (isVisible()) pose_jaws();
        show_gates();
        if (*mesh) {
          Layer layer;
          layer.id = "splint";
          layer.name = "Splint";
          layer.group = "Design";
          layer.mesh = *mesh;
          layer.color_3d = palette::kSplintClear;
          layer.color_2d = palette::kSplint;
          layer.width_2d_px = 2.4;
          layer.opacity = 0.8;
          document().layers().put(std::move(layer));
          document().layers().set_visible("splint", true);
          preview_->setChecked(false);
          make_maps();
        }
        compare_->refresh();
        show_state();
        document().notice("Built: designs/" + QString::fromStdString(folder.filename().string()));
      });
}

}  // namespace gnathion
