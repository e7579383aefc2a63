"""All studies, by name, in the order of the report. Listing them imports nothing heavy."""

from __future__ import annotations

from collections.abc import Sequence

from featherfx.errors import InputError, Problem
from featherfx.lab.studies.study import Study

# of each: name, module and function here, title; then what it reproduces
LISTED = """\
elastica rods:elastica Cantilever under a force at its tip
    Bisshopp and Drucker 1945; Mattiasson 1981, table 1
heavy_elastica rods:heavy Rod clamped level under its weight
    Kirchhoff's rod, by shooting
bend_45 rods:bend_of_45_degrees 45 degree bend
    Bathe and Bolourchi 1979; Simo and Vu-Quoc 1986
frequencies rods:frequencies Natural frequencies of a clamped rod
    closed form; Rayleigh and Ritz
released_rod rods:released A rod let go
    chain of rigid links
feather_masses feathers:masses Presets beside feathers that were weighed, shaken and pulled
    Harvey et al. 2022, data of AvInertia; abstracts of Deng et al. 2022 and others
vane_traction vane:traction Traction of vane samples
    Jouve 2024, chapter 4
vane_locking vane:locking Locking of unaligned meshes
    Jouve 2024, figures 4.4 and 4.7; Jouve et al. 2024, figure 5
vane_mesoscale vane:mesoscale Barbs and barbules as bands
    Jouve 2024, eq. 5.2 and 5.4, table 5.1
vane_size_effect vane:size_effect Size effect in compression along the barbs
    Jouve 2024, figures A.5 and A.6
vane_shear_modulus vane:shear_modulus Shear modulus of the membrane from tilted tests of bands
    Jouve 2024, tables 5.2 and D.2; Jouve et al. 2024, table 1
vane_samples samples:samples The measured samples: tilted tests, Poisson effect, share of barbs
    Jouve 2024, table 3.1, section 3.3, figures 3.10, 5.6, 5.8 and D.3
vane_penalty vane:penalty Stiff barbs beside barbs of constant length
    Jouve et al. 2024, figure 6
vane_calibration vane:calibration Moduli recovered from stress-strain curves
    Jouve 2024, chapter 5
vane_angles vane:angles Slopes at all angles, and the shear band
    Jouve 2024, figures 5.11 and 5.12; Jouve et al. 2024, figures 9 and 11
ribbon_cantilever ribbons:cantilever Ribbon and rod clamped level, under their weight
    Charrondiere et al. 2019, figure 7
ribbon_hanging ribbons:hanging A curled ribbon leaves its plane as its length grows
    Charrondiere et al. 2019, section 5.1 and figure 9
ribbon_degree ribbons:degree A curled ribbon by rigid links and by power series
    Charrondiere et al. 2019, sections 3.2 and 3.3
ribbon_shell ribbons:shell A thin shell beside the ribbon
    Charrondiere et al. 2019, section 5.3 and figure 6
ribbon_and_rod ribbons:against_rod The curled ribbon beside a rod of rectangular section
    Charrondiere et al. 2019, section 5.5 and figure 9
ribbon_ends ribbons:ends A curled ribbon by its equations of equilibrium, and one held at both ends
    Charrondiere et al. 2019, sections 5.2 and 6
full_feather_side full_feather:side_pull A whole feather, its vane pulled
    Jouve 2024, figure 6.9; Jouve et al. 2024, figure 1
full_feather_tip full_feather:tip_pull A whole feather, its tip pulled
    Jouve 2024, figure 6.5
guard_truss full_feather:guard Does a penalty on lost area make a truss buckle?
    Jouve 2024, equation 6.6 and figure 6.8
fibre_elements unit_cell:elements Bend triplets: cantilever, plane against space, affine bound
    Houghton 2020, chapters 3, 5 and 6
fibre_lattice networks:lattice Triangular lattices, whole and diluted, and their iterative solution
    Houghton 2020, section 5.3, tables 5.4 and 5.5; section 2.2.4
fibre_random networks:random Random networks: rigidity, affinity, iterative solution
    Houghton 2020, section 5.4, figure 5.14 and table 5.6; section 2.2.4
fibre_merging networks:merging What merging of near crossings costs
    Houghton 2020, section 5.2.4, tables 5.1 to 5.3
fibre_large networks:large Networks under large strain
    Houghton 2020, section 7.1
fibre_space space:small Small networks in space, in a medium, and by steps of pseudo-time
    Houghton 2020, sections 6.2 and 6.4, tables 6.5 to 6.8
fibre_layers space:random Random networks in space and layers of them
    Houghton 2020, sections 6.3 and 6.4, table 6.3, figures 6.16 to 6.25
fibre_contours space:contours Shares of the energy of layers, over density and distance
    Houghton 2020, figures 6.19, 6.20 and 6.26 to 6.28
fibre_solvers solvers:lattices A sparse factorisation beside preconditioned iterations
    Houghton 2020, section 5.3
vane_solvers solvers:vane Preconditioned iterations on the nodal matrix of a vane
    Houghton 2020, section 4.2, on a feather
fibre_rupture fibre_rupture:rupture A membrane of fibres is pulled until it tears
    Jacquemoud 2007, sections 4.5 and 4.6
tissue_laws tissue:laws Laws of soft tissue with the parameters printed for skin
    Jacquemoud 2007, sections 2.4 to 2.6, tables 2-1, 2-2 and A5-3
unit_cell unit_cell:lattice The vane as a lattice of barbs and barbules
    Houghton 2020, applied to the moduli of Jouve 2024, tables 5.1 and 5.2
"""


def _listed() -> tuple[Study, ...]:
    lines, found = LISTED.splitlines(), []
    for head, reproduces in zip(lines[::2], lines[1::2], strict=True):
        name, place, title = head.split(" ", 2)
        found.append(Study(name, title, reproduces.strip(), f"featherfx.lab.studies.{place}"))
    return tuple(found)


STUDIES = _listed()


def studies(names: Sequence[str] = ()) -> list[Study]:
    """The studies of the given names, or all; in the order of the report.

    Raises InputError with every name that there is no study of.
    """
    known = {study.name: study for study in STUDIES}
    wrong = [name for name in dict.fromkeys(names) if name not in known]
    if wrong:
        allowed = ", ".join(known)
        raise InputError(
            *(Problem("lab", "only", f"'{each}'; allowed: {allowed}") for each in wrong)
        )
    return [study for study in STUDIES if not names or study.name in names]
