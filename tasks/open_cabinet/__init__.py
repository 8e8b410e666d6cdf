"""The open_cabinet domain: grasp the handle of a drawer and pull it open."""
