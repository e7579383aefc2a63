"""Maya runs this when it starts: the menu comes when its windows are there."""

from maya import cmds

if not cmds.about(batch=True):
    cmds.evalDeferred("import featherfx_maya; featherfx_maya.make_menu()", lowestPriority=True)
