// Transformations of the virtual patient whose verdict is known: half of them are made to violate one
// constraint. Truth comes from how they were made, from the phantom's landmarks and labels, from its own
// measure of the clearance, and from distances over all pairs of triangles.
#pragma once

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "anatomy/realizability.h"
#include "core/mesh_query.h"
#include "core/random.h"
#include "phantom/jaws.h"
#include "phantom/jaws_bite.h"
#include "phantom/joints.h"

namespace gnathion::test {

struct Trial {
  Rigid3 motion;         ///< in the patient's frame
  std::string violates;  ///< name of the constraint; empty: free by 0.5 mm
};

struct TrialCount {
  int trials = 0, violating = 0, wrong = 0, refused_though_free = 0, distances = 0;
  double worst_distance_mm = 0.0;
  std::vector<std::string> failures;
};

inline Joints joints_of(const PhantomJoints& truth) {
  Joints joints;
  joints.source = "the phantom";
  const auto take = [](Side side, const PhantomJoint& p) {
    Joint j;
    j.side = side;
    j.condyle = p.condyle, j.fossa = p.fossa;
    j.medial_pole_mm = p.medial_pole_mm, j.lateral_pole_mm = p.lateral_pole_mm;
    return j;
  };
  joints.left = take(Side::kLeft, truth.left);
  joints.right = take(Side::kRight, truth.right);
  return joints;
}
inline Joints true_joints(const PhantomJaws& jaws) {
  return joints_of(phantom_joints(jaws));
}

class RealizabilityTrials {
 public:
  RealizabilityTrials(std::uint64_t patient_seed, std::uint64_t seed)
      : jaws_(make_phantom_jaws(patient_seed)),
        bite_(measure_bite(jaws_)),
        maxilla_(jaws_.maxilla),
        mandible_(jaws_.mandible_mi),
        upper_crowns_(crowns_of(jaws_.maxilla, jaws_.maxilla_fdi)),
        lower_crowns_(crowns_of(jaws_.mandible_mi, jaws_.mandible_fdi)),
        random_(seed, 0x7121A1) {}

  const PhantomJaws& jaws() const { return jaws_; }

  /// Free by 0.5 mm in every respect.
  Trial free_trial() {
    for (;;) {
      const Rigid3 m =
          slide({random_.uniform(-1.0, 1.0), -random_.uniform(0.0, 3.0), -random_.uniform(0.5, 2.5)}) *
          open(random_.uniform(2.0, 8.0));
      if (clearance_mm(m) >= 0.5 && gap_mm(m, true) >= 0.5 && gap_mm(m, false) >= 0.5) return {m, ""};
    }
  }
  Trial violating_trial(int kind) {
    Random& r = random_;
    switch (kind % 9) {
      case 0: {  // up from a free place until the teeth pass through each other
        const Rigid3 start = free_trial().motion;
        for (double up = 0.1;; up += 0.1)
          if (const Rigid3 m = slide({0, 0, up}) * start; clearance_mm(m) < -0.4)
            return {m, "no_intersection"};
      }
      case 1:
        return {slide({0, r.uniform(-2, 2), r.uniform(20, 40)}), "mandible_below_maxilla"};
      case 2:  // open, so that the teeth are free, and both condyles pressed up
        for (;;) {
          const Rigid3 m = slide({0, r.uniform(-0.5, 0.5), r.uniform(2.3, 4.5)}) * open(r.uniform(9.0, 12.0));
          if (clearance_mm(m) > 0.5 && gap_mm(m, true) <= 0.0) return {m, "condyle_fossa"};
        }
      case 3:
        return {slide({0, r.uniform(2.2, 4.0), -r.uniform(2.0, 4.0)}) * open(r.uniform(3.0, 6.0)),
                "condyle_back"};
      case 4:
        return {slide({0, 0, -5}) * Rigid3::about_axis(jaws_.landmarks.condyle_left_mm, Vector3::UnitZ(),
                                                       r.uniform(9.0, 12.0) * M_PI / 180.0),
                "yaw"};
      case 5:
        return {slide({0, -r.uniform(13.0, 15.0), -r.uniform(7.0, 10.0)}), "protrusion"};
      case 6:
        return {slide({0, -r.uniform(2.0, 5.0), -r.uniform(2.0, 4.0)}) * open(r.uniform(17.5, 24.0)),
                "vertical_opening"};
      case 7:
        return {slide({(r.uniform() < 0.5 ? -1 : 1) * r.uniform(13.0, 15.0), -2, -5}), "laterotrusion"};
      default:
        return {slide({0, 0, -8}) *
                    Rigid3::about_axis({0, 30, 0}, Vector3::UnitY(),
                                       (r.uniform() < 0.5 ? -1 : 1) * r.uniform(6.0, 8.0) * M_PI / 180.0),
                "roll"};
    }
  }

  /// Asks the checker in a frame that is not the patient's own, and compares.
  void judge(const Trial& trial, const RealizabilityChecker& checker, const Rigid3& pose, TrialCount* count) {
    const Feasibility f = checker.check(Motion<Dental>(pose * trial.motion * pose.inverse()));
    const std::vector<std::string> violated = f.violated();
    const auto complain = [&](const std::string& why) {
      std::string text = trial.violates.empty() ? "free" : trial.violates;
      text += ": " + why + "; said " + verdict_name(f.verdict);
      for (const std::string& name : violated) text += " " + name;
      count->failures.push_back(text);
      ++count->wrong;
    };
    ++count->trials;
    if (trial.violates.empty()) {
      if (f.verdict == Verdict::kNotRealizable) {
        ++count->refused_though_free;
        complain("refused");
      }
    } else {
      ++count->violating;
      if (f.verdict != Verdict::kNotRealizable ||
          std::find(violated.begin(), violated.end(), trial.violates) == violated.end())
        complain("not named");
    }
    compare_room(trial, f, complain);
    compare_support(trial, f, complain);
    for (const JointReport& r : f.joints) {
      const double truth = gap_mm(trial.motion, r.side == Side::kLeft);
      if (truth <= 0.0 || truth > 20.0) continue;
      ++count->distances;
      const double off = std::abs(r.tp.min_mm - truth);
      if (r.tp.min_mm < 0.0) continue;  // beyond the fossa: no distance to compare
      count->worst_distance_mm = std::max(count->worst_distance_mm, off);
      if (off > 0.05)
        complain(fmt::format("{} joint {:.3f}, truth {:.3f} mm", side_name(r.side), r.tp.min_mm, truth));
    }
  }

 private:
  Rigid3 open(double deg) const {
    const PhantomLandmarks& l = jaws_.landmarks;
    return Rigid3::about_axis(l.condyle_right_mm, l.condyle_left_mm - l.condyle_right_mm, deg * M_PI / 180.0);
  }
  static Rigid3 slide(const Vector3& t) { return Rigid3::from_translation(t); }
  /// Of the crowns' vertices, both ways; no more than 3 mm.
  double clearance_mm(const Rigid3& motion) const {
    return std::min(crowns_to(maxilla_, lower_crowns_, motion),
                    crowns_to(mandible_, upper_crowns_, motion.inverse()));
  }
  static double crowns_to(const MeshQuery& jaw, const std::vector<Vector3>& crowns, const Rigid3& motion) {
    std::vector<Vector3> moved;
    for (const Vector3& p : crowns) moved.push_back(motion * p);
    double least = 3.0;
    for (const ClosestHit& hit : closest_points(jaw, moved, 3.0))
      if (hit.triangle != ClosestHit::kNoTriangle) least = std::min(least, hit.distance_mm);
    return least;
  }
  static std::vector<Vector3> crowns_of(const TriangleMesh& mesh, const std::vector<std::uint8_t>& fdi) {
    std::vector<Vector3> out;
    for (std::size_t i = 0; i < fdi.size(); ++i)
      if (fdi[i] != 0) out.push_back(mesh.vertices_mm[i]);
    return out;
  }
  double gap_mm(const Rigid3& motion, bool left) const {
    return smallest_gap(transformed(motion, left ? jaws_.condyle_left : jaws_.condyle_right),
                        left ? jaws_.fossa_left : jaws_.fossa_right)
        .distance_mm;
  }

  /// Apertures exactly where the room between the crowns is less than half a millimetre.
  template <class Complain>
  void compare_room(const Trial& trial, const Feasibility& f, Complain complain) const {
    if (!trial.violates.empty()) return;
    const double truth = clearance_mm(trial.motion);
    if (std::abs(truth - 0.5) < 0.1 || truth > 2.5) return;
    const bool apertures = f.verdict == Verdict::kRealizableWithApertures;
    if (apertures != (truth < 0.5)) complain(fmt::format("clearance {:.2f} mm", truth));
  }
  /// The weaker side's share of MI's contacts that keep a wall, by the phantom's own contacts.
  template <class Complain>
  void compare_support(const Trial& trial, const Feasibility& f, Complain complain) const {
    double left = 0.0, right = 0.0;
    for (const BiteContact& c : bite_.contacts) {
      const auto d = maxilla_.signed_distance(trial.motion * c.point_mm, 10.0);
      if (d && d->distance_mm < 0.5) continue;
      (c.point_mm.x() > 0.0 ? left : right) += c.area_mm2;
    }
    if (!trial.violates.empty() || left + right <= 0.0) return;
    const double share = std::min(left, right) / (left + right);
    if (share > 0.08 && share < 0.25) return;  // contacts are not told to better than this
    for (const Constraint& c : f.constraints)
      if (c.name == "uniform_contact" && c.pass != (share >= 0.15))
        complain(fmt::format("weaker side {:.2f}, truth {:.2f}", c.value, share));
  }

  PhantomJaws jaws_;
  PhantomBite bite_;
  MeshQuery maxilla_, mandible_;
  std::vector<Vector3> upper_crowns_, lower_crowns_;
  Random random_;
};

/// `count` transformations on each patient, every second one made to violate a constraint.
inline TrialCount run_trials(std::uint64_t patient_seed, std::uint64_t seed, int count) {
  TrialCount out;
  RealizabilityTrials trials(patient_seed, seed);
  Random random(seed, 0xF2A3E);
  const Rigid3 pose{random.rotation(), 100.0 * random.normal3()};
  auto checker = RealizabilityChecker::create(transformed(pose, trials.jaws().maxilla),
                                              transformed(pose, trials.jaws().mandible_mi));
  if (!checker) {
    out.failures.push_back(checker.error().line());
    ++out.wrong;
    return out;
  }
  Joints joints = true_joints(trials.jaws());
  for (auto* joint : {&joints.left, &joints.right}) {
    (*joint)->condyle = transformed(pose, (*joint)->condyle);
    (*joint)->fossa = transformed(pose, (*joint)->fossa);
    (*joint)->medial_pole_mm = pose * (*joint)->medial_pole_mm;
    (*joint)->lateral_pole_mm = pose * (*joint)->lateral_pole_mm;
  }
  checker->use_joints(joints);
  for (int i = 0; i < count; ++i)
    trials.judge(i % 2 == 0 ? trials.free_trial() : trials.violating_trial(i / 2), *checker, pose, &out);
  return out;
}

}  // namespace gnathion::test
